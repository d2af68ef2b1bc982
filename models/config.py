"""Every number of the two networks, with its source (Table I of the paper, or a choice of ours).

Letters used in models/: B batch, N points, M sampled points, K neighbours, C channels.
"""

from dataclasses import MISSING, dataclass, field
from typing import Any, Literal, get_args

from common.errors import InputError
from kitti.objects import CLASSES, class_name

Fusion = Literal["elementwise_product", "concat", "cosine_distance", "dot_product", "none"]
"""Table III, and none: no association, only frame t-1 is refined (not in the paper)."""
FusedFeatures = Literal["DSA2+DFP2", "DSA3+DFP3", "filter+FC2", "filter+FC1"]  # Table IV
FUSED_FEATURES: tuple[str, ...] = get_args(FusedFeatures)


MAX_POINTS, MAX_WIDTH, MAX_NEIGHBORS = 200_000, 8192, 4096
"""Bounds of values read from files: far beyond any use, within the memory of a machine."""
MIN_RADIUS = 1e-3  # metres; coordinates are divided by the radius
MAX_MOMENTUM = 0.9999  # at 1 the moving averages keep their initial values
MAX_WEIGHT = 1e6  # of a loss term, far below float32's largest number


def note(default, text: str, least: float = 0, most: float | None = None):
    """A field with its help text and its bounds, see `common.config`; no bound is below 0."""
    bounds = {"least": least} if most is None else {"least": least, "most": most}
    return field(default=default, metadata={"help": text, **bounds})


def _between(least: float, most: float, default: Any = MISSING):
    return field(default=default, metadata={"least": least, "most": most})


@dataclass(frozen=True)
class SetAbstractionConfig:
    """One SA row of Table I, single-scale grouping."""

    num_points: int = _between(1, MAX_POINTS)
    radius: float = _between(MIN_RADIUS, 1000)  # metres
    widths: tuple[int, ...] = _between(1, MAX_WIDTH)
    num_neighbors: int = _between(1, MAX_NEIGHBORS, 32)  # open in the paper; PointNet++'s value


@dataclass(frozen=True)
class SetUpconvConfig:
    """One FP row of Table I with a radius: a set upconv layer (FlowNet3D).

    The last width is the layer after pooling and the skip connection, as in FlowNet3D.
    """

    radius: float = _between(
        MIN_RADIUS, 1000
    )  # metres; neighbours outside are replaced by the nearest
    widths: tuple[int, ...] = _between(1, MAX_WIDTH)
    num_neighbors: int = _between(1, MAX_NEIGHBORS, 8)  # FlowNet3D

    def __post_init__(self):
        if len(self.widths) < 2:
            found = f"found {' '.join(map(str, self.widths))}"
            raise InputError(f"set_upconv: expected two or more widths of a layer, {found}")


def _sa(num_points: int, radius: float, *widths: int) -> SetAbstractionConfig:
    return SetAbstractionConfig(num_points, radius, widths)


@dataclass(frozen=True)
class BoxCodingConfig:
    """Heading bins, size templates and classes of the detector's head (Frustum PointNets)."""

    num_heading_bins: int = note(12, "NH (Frustum PointNets)", 1, 360)
    classes: tuple[str, ...] = note(("Car", "Van"), "NC semantic classes: the paper's vehicles")
    size_templates: tuple[tuple[float, float, float], ...] = note(
        ((3.902, 1.620, 1.517), (4.935, 1.866, 2.167)),
        "NS templates (l, w, h) in metres: means over the labels of sequences 0001-0015",
        0.01,
        100,
    )
    quality: bool = note(
        True, "predict the 3-D IoU of a point's box with its object (not in the paper: IoU-Net)"
    )

    def __post_init__(self):
        object.__setattr__(self, "classes", tuple(class_name(name) for name in self.classes))
        labelled = [name for name in CLASSES if name != "DontCare"]
        if not set(self.classes) <= set(labelled) or len(set(self.classes)) < len(self.classes):
            expected = f"expected each once of {' '.join(labelled)}"
            raise InputError(f"box.classes: {expected}, found {' '.join(self.classes)}")


@dataclass(frozen=True)
class DetectorConfig:
    """The detector's rows of Table I."""

    num_points: int = note(15000, "N (section IV.B)", 1, MAX_POINTS)
    point_features: Literal["none", "height", "height+range"] = note(
        "height+range",
        "features made from the coordinates of a point; none = the plain N x 3 input",
    )
    set_abstraction: tuple[SetAbstractionConfig, ...] = note(
        (
            _sa(2048, 1.0, 32, 32, 64),
            _sa(512, 2.0, 64, 64, 128),
            _sa(128, 4.0, 128, 128, 256),
            _sa(32, 8.0, 256, 256, 512),
        ),
        "SA1 to SA4",
    )
    set_upconv: tuple[SetUpconvConfig, ...] = note(
        (
            SetUpconvConfig(8.0, (256, 256)),
            SetUpconvConfig(4.0, (128, 128, 256)),
            SetUpconvConfig(2.0, (128, 128, 256)),
        ),
        "FP1 to FP3",
    )
    propagation_widths: tuple[int, ...] = note((256, 256), "FP4", 1, MAX_WIDTH)
    fc1_width: int = note(128, "FC1", 1, MAX_WIDTH)
    box: BoxCodingConfig = field(default_factory=BoxCodingConfig)
    batch_norm_momentum: float = note(
        0.97, "moving averages; choice of ours for short trainings", 0, MAX_MOMENTUM
    )

    def __post_init__(self):
        down, up = len(self.set_abstraction), len(self.set_upconv)
        if up != down - 1:
            expected = f"expected {down - 1} layers, one fewer than set_abstraction has"
            raise InputError(f"set_upconv: {expected}, found {up}")


@dataclass(frozen=True)
class TrackerConfig:
    """The tracker's rows of Table I."""

    num_kept_points: int = note(5000, "N' of the probability filter (section IV.B)", 1, MAX_POINTS)
    fused_features: FusedFeatures = note("filter+FC1", "Table IV; its best row")
    fusion: Fusion = note("cosine_distance", "Table III; its best row")
    fusion_keeps_features: bool = note(
        True,
        "append the fused value to [f_i, f_j, d_j] (the text of section III.2) instead of using it "
        "in place of f_i and f_j (FlowNet3D)",
    )
    set_abstraction: tuple[SetAbstractionConfig, SetAbstractionConfig] = note(
        (_sa(2048, 0.5, 32, 32, 64), _sa(512, 1.0, 64, 64, 128)), "SA1 and SA2, both frames"
    )
    association_radius: float = note(5.0, "Assn. (metres)", MIN_RADIUS, 1000)
    association_neighbors: int = note(64, "K (section IV.B)", 1, MAX_NEIGHBORS)
    association_widths: tuple[int, ...] = note((128, 128), "Assn.", 1, MAX_WIDTH)
    refinement_abstraction: SetAbstractionConfig = _sa(32, 4.0, 256, 256)  # SA3
    refinement_upconv: tuple[SetUpconvConfig, SetUpconvConfig] = note(
        (SetUpconvConfig(4.0, (256, 256)), SetUpconvConfig(1.0, (128, 256, 256))), "FP1 and FP2"
    )
    propagation_widths: tuple[int, ...] = note((256, 256), "FP3", 1, MAX_WIDTH)
    fc1_width: int = note(128, "FC1", 1, MAX_WIDTH)
    batch_norm_momentum: float = note(
        0.97, "moving averages; choice of ours for short trainings", 0, MAX_MOMENTUM
    )


@dataclass(frozen=True)
class DetectionLossWeights:
    """Weight of each term; equations (2) and (3) have 1 everywhere."""

    mask: float = note(1.0, "L_mask", 0, MAX_WEIGHT)
    center: float = note(1.0, "L_center", 0, MAX_WEIGHT)
    h_cls: float = note(1.0, "L_h_cls", 0, MAX_WEIGHT)
    h_reg: float = note(1.0, "L_h_reg", 0, MAX_WEIGHT)
    s_cls: float = note(1.0, "L_s_cls", 0, MAX_WEIGHT)
    s_reg: float = note(
        10.0, "L_s_reg; as a share of the template it is small (vans too short)", 0, MAX_WEIGHT
    )
    sem_cls: float = note(1.0, "L_sem_cls", 0, MAX_WEIGHT)
    quality: float = note(1.0, "predicted 3-D IoU; not in the paper", 0, MAX_WEIGHT)


@dataclass(frozen=True)
class TrackingLossWeights:
    """alpha and beta of equation (5): 1 unless measured better."""

    alpha: float = note(1.0, "weight of foreground points, equation (5)", 0, MAX_WEIGHT)
    beta: float = note(1.0, "weight of background points, equation (5)", 0, MAX_WEIGHT)


@dataclass(frozen=True)
class DecodingConfig:
    """Decoding of boxes from the predictions at points.

    Chosen on simulated scans of sequence 0011, which is held out of training:
    docs/tables/decoding_parameters.md (studies/decoding_parameters.py).
    """

    min_probability: float = note(0.4, "foreground probability of a point that proposes a box")
    cell: float = note(0.5, "metres; proposals are thinned by the cell of their centre")
    proposals_per_cell: int = note(40, "the most probable ones of each cell stay")
    max_proposals: int = note(600, "of a frame")
    nms_iou: float = note(0.02, "boxes that overlap more are of the same object")
    vote_iou: float = note(0.4, "proposals that overlap more are averaged (box voting)")
    score_prior: float = note(4.0, "pseudo-count in the score: boxes of few proposals score less")
    min_score: float = note(0.3, "of a box that is kept, where the weights ship no other")
    max_boxes: int = note(64, "M")
