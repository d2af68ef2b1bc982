"""Constants of the simulator, each with its source, in frozen dataclasses."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SensorConfig:
    """HDL-64E S2 on KITTI's car. Angles in degrees, lengths in metres.

    Nominal elevations are +2 to -8.33 in steps of 1/3 (upper 32 lasers) and -8.83 to -24.33 in
    steps of 1/2 (lower 32), Velodyne HDL-64E S2 manual. The values here are a robust line fit
    z = height + rho * tan(elevation) to each ring of 26 real scans of sequence 0000: lasers sit
    in groups at different heights in the housing.
    """

    # lasers, elevation of the first, step downwards, height of their origin
    groups: tuple[tuple[int, float, float, float], ...] = (
        (17, 1.815, 0.341, 0.290),
        (15, -3.814, 0.331, 0.205),
        (32, -8.520, 0.495, 0.070),
    )
    azimuth_step_deg: float = 0.1798  # median step along rings of the real scans; 10 Hz
    period_s: float = 0.1
    mount_height: float = 1.73  # above the ground, Geiger et al., IJRR 2013
    camera_height: float = 1.65  # above the ground, same source
    view_half_angle_deg: float = 42.5  # the view of camera 2 is +-41 degrees
    view_nearest: float = 2.0  # the camera's view holds the beams that it sees from here on
    max_range: float = 79.0  # farthest points of the real scans; S2 manual: 120 m at high albedo
    min_range: float = 0.9
    range_noise: float = 0.018  # < 2 cm, S2 manual
    quantum: float = 0.001  # KITTI writes millimetres


@dataclass(frozen=True)
class ReturnConfig:
    """Probability of a return: base * sigmoid(slope * (log(rho * cos^power / r^2) - threshold)).

    The lidar equation for a diffuse surface; `power` below 1 models rough surfaces.
    Fitted by hand to points per frame and per vehicle of sequence 0000 (see the fidelity table).
    """

    base: float = 0.997  # 0.4 % of near rays are missing along the real rings
    slope: float = 2.0
    threshold: float = -11.1
    cosine_power: float = 0.5
    glass_surface: float = 0.12  # share of rays that return from a window pane
    glass_absorbed: float = 0.55  # share that is lost; the rest goes through
    interior_return: float = 0.7


@dataclass(frozen=True)
class SizeFit:
    """Mean and standard deviation of (l, w, h) in metres over tracks, and correlations."""

    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    correlation_lw: float
    correlation_lh: float
    correlation_wh: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class SizeConfig:
    """Moments over the tracks (one size a track) of KITTI's tracking labels 0000-0015."""

    car: SizeFit = SizeFit(
        (3.916, 1.623, 1.517), (0.430, 0.113, 0.124), 0.35, 0.15, 0.32,
        (2.9, 1.40, 1.25), (5.2, 1.95, 1.95),
    )  # fmt: skip
    van: SizeFit = SizeFit(
        (4.969, 1.913, 2.197), (0.758, 0.196, 0.415), 0.66, 0.74, 0.65,
        (3.8, 1.64, 1.65), (6.9, 2.52, 3.5),
    )  # fmt: skip
    truck: SizeFit = SizeFit(
        (8.954, 2.529, 3.239), (2.225, 0.258, 0.474), 0.44, 0.25, 0.75,
        (5.4, 2.06, 2.3), (11.9, 3.0, 4.2),
    )  # fmt: skip
    pedestrian: SizeFit = SizeFit(
        (0.720, 0.594, 1.709), (0.255, 0.131, 0.147), 0.16, 0.31, 0.37,
        (0.35, 0.35, 1.17), (1.35, 0.94, 1.96),
    )  # fmt: skip
    cyclist: SizeFit = SizeFit(
        (1.758, 0.571, 1.724), (0.152, 0.133, 0.105), 0.41, 0.43, -0.11,
        (1.35, 0.38, 1.45), (2.0, 0.88, 1.9),
    )  # fmt: skip


@dataclass(frozen=True)
class VehicleMix:
    """Shares of types among the vehicles of own traffic; the rest are cars.

    The defaults give 8 % vans and 3 % trucks among the labelled vehicles; in KITTI's tracking
    labels 0000-0015 they are 9 % and 5 %, in sequence 0000 55 % and none.
    """

    moving_vans: float = 0.10
    moving_trucks: float = 0.03
    parked_vans: float = 0.06  # along the kerb; cars alone stand across

    @classmethod
    def with_vans(cls, share: float | None) -> "VehicleMix":
        """The mix with `share` vans among vehicles that move and that park along the kerb."""
        return cls() if share is None else cls(moving_vans=share, parked_vans=share)


SENSOR = SensorConfig()
RETURNS = ReturnConfig()
SIZES = SizeConfig()
