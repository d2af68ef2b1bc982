"""Label rows for hand-made files."""

CAR_ROW = "{frame} {id} {kind} 0 1 -1.5 100.0 120.0 200.0 180.0 1.5 1.6 4.0 2.0 1.7 {z} 0.3"


def label_row(frame: int, track_id: int, kind: str = "Car", z: float = 20.0) -> str:
    """One label row of 17 columns."""
    return CAR_ROW.format(frame=frame, id=track_id, kind=kind, z=z)


DONT_CARE = "{frame} -1 DontCare -1 -1 -10 5 6 7 8 -1000 -1000 -1000 -10 -1 -1 -1"


def dont_care_row(frame: int) -> str:
    """One DontCare row, as KITTI's tracking labels have it."""
    return DONT_CARE.format(frame=frame)


DETECTION = "{frame},2,100.0,120.0,200.0,180.0,{score},1.5,1.6,4.0,2.0,1.7,20.0,0.3,-1.5"
"""A row of detections, in the layout of one file for each sequence."""


def write_rows(path, rows):
    """Writes the rows; returns the path."""
    path.write_text("".join(row + "\n" for row in rows))
    return path
