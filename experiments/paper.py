"""Numbers printed in the papers, for comparison with ours."""

TABLE5_COLUMNS = ("MOTA", "MOTP", "MT", "ML", "IDS", "FRAG")

# Table V of the PointTrackNet paper: boxes -> method -> D in metres -> the six columns above.
# "PointTrackNet" with ground-truth boxes still uses its predicted displacement.
TABLE5 = {
    "predicted": {
        "SORT": {
            0.0: (0.611, 0.797, 0.728, 0.032, 99, 162),
            2.0: (0.357, 0.807, 0.032, 0.184, 87, 205),
        },
        "DEEP_SORT": {
            0.0: (0.648, 0.805, 0.652, 0.054, 87, 151),
            2.0: (0.259, 0.811, 0.000, 0.293, 80, 137),
        },
        "PointTrackNet": {
            0.0: (0.738, 0.804, 0.750, 0.021, 68, 135),
            2.0: (0.647, 0.812, 0.445, 0.130, 78, 144),
        },
    },
    "gt": {
        "SORT": {
            0.0: (0.927, 0.933, 0.976, 0.000, 43, 53),
            2.0: (0.601, 1.000, 0.228, 0.032, 107, 228),
        },
        "DEEP_SORT": {
            0.0: (0.926, 0.933, 0.976, 0.000, 42, 56),
            2.0: (0.698, 1.000, 0.423, 0.021, 126, 239),
        },
        "PointTrackNet": {
            0.0: (0.978, 0.933, 1.000, 0.000, 34, 39),
            2.0: (0.957, 1.000, 0.989, 0.000, 29, 44),
        },
    },
}

# Tables III and IV: row -> the first four columns above. The paper specifies neither boxes nor
# displacement; the best rows (0.747, 0.739) are near Table V's predicted boxes at 0 m (0.738).
TABLE3 = {
    "elementwise product": (0.704, 0.792, 0.539, 0.080),
    "concat": (0.717, 0.790, 0.65, 0.044),
    "cosine distance": (0.747, 0.811, 0.68, 0.047),
    "dot product": (0.734, 0.810, 0.74, 0.036),
}
TABLE4 = {
    "DSA2 + DFP2": (0.602, 0.800, 0.639, 0.062),
    "DSA3 + DFP3": (0.634, 0.795, 0.612, 0.075),
    "Filter + FC2": (0.707, 0.801, 0.685, 0.040),
    "Filter + FC1": (0.739, 0.800, 0.710, 0.034),
}

# Table VI: PointTrackNet on KITTI's test server, the six columns above.
TABLE6 = (0.6823, 0.7657, 0.6062, 0.1231, 111, 725)

# AB3DMOT's published evaluation of its own tracker on PointRCNN cars of the 11 sequences below, at
# the score threshold of the best MOTA (its docs/KITTI.md): sAMOTA, MOTA, MOTP, IDS, FRAG, FP, FN.
AB3DMOT_SEQUENCES = (1, 6, 8, 10, 12, 13, 14, 15, 16, 18, 19)
AB3DMOT_COLUMNS = ("sAMOTA", "MOTA", "MOTP", "IDS", "FRAG", "FP", "FN")
AB3DMOT = {
    "3-D IoU 0.25": (0.9334, 0.8647, 0.7940, 0, 15, 368, 766),
    "3-D IoU 0.5": (0.9257, 0.8481, 0.7982, 0, 49, 456, 817),
    "3-D IoU 0.7": (0.7496, 0.6248, 0.8264, 0, 173, 1065, 2079),
    "2-D IoU 0.5": (0.9308, 0.8598, 0.8695, 2, 25, 394, 779),
}
