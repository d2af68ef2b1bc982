"""Bodies of pedestrians, sitting persons and cyclists, scaled to a label's box."""

from simulator.bodies.convex import Body
from simulator.bodies.parts import Part, assemble, block, column, wheel

SKIN, STEEL = 0.45, 0.3


def pedestrian(size, rng) -> Body:
    """A walking person of `size` (l, w, h) metres; the stride fills the box's length."""
    length, width, height = (float(value) for value in size)
    low = -height / 2
    cloth, trousers = (float(value) for value in rng.uniform(0.1, 0.7, 2))
    thick = min(0.15, length / 2 - 0.02)
    broad = min(0.26, width / 2 - 0.02)
    stride = max(length / 2 - 0.12, 0.02) * float(rng.uniform(0.3, 1.0))
    hip, neck = low + 0.48 * height, low + 0.84 * height
    arm = max(width / 2 - 0.07, 0.1)
    parts = [
        Part(column(stride, 0.09, low, hip, 0.09, 0.08), trousers),
        Part(column(-stride, -0.09, low, hip, 0.09, 0.08), trousers),
        Part(column(0, 0, hip - 0.05, neck, thick, broad), cloth),
        Part(column(-stride / 2, arm, hip - 0.1, neck - 0.08, 0.06, 0.06), cloth),
        Part(column(stride / 2, -arm, hip - 0.1, neck - 0.08, 0.06, 0.06), cloth),
        Part(column(0.02, 0, neck, height / 2 - 0.01, 0.1, 0.085), SKIN),
    ]
    return assemble(parts)


def sitting(size, rng) -> Body:
    """A sitting person of `size` (l, w, h) metres."""
    length, width, height = (float(value) for value in size)
    low = -height / 2
    cloth = float(rng.uniform(0.1, 0.7))
    parts = [
        Part(block((-0.2 * length, 0, low + 0.6 * height), (0.3, 0.8 * width, 0.45 * height)),
             cloth),
        Part(block((0.05, 0, low + 0.38 * height), (0.8 * length, 0.7 * width, 0.16)), cloth),
        Part(block((0.35 * length, 0, low + 0.17 * height), (0.15, 0.6 * width, 0.34 * height)),
             cloth),
        Part(column(-0.15 * length, 0, low + 0.8 * height, height / 2, 0.1, 0.09), SKIN),
    ]  # fmt: skip
    return assemble(parts)


def cyclist(size, rng) -> Body:
    """A cyclist of `size` (l, w, h) metres: two spoked wheels, a frame and a rider."""
    length, width, height = (float(value) for value in size)
    low = -height / 2
    half = length / 2 - 0.02
    radius = min(0.34, half / 2)
    cloth = float(rng.uniform(0.1, 0.7))
    seat = low + 0.52 * height
    torso = block(
        (-0.08, 0, seat + 0.17 * height), (0.26, min(0.42, width - 0.06), 0.36 * height), 0.9
    )
    parts = [
        Part(wheel(half - radius, 0, low + radius, radius, 0.05), STEEL, porosity=0.65),
        Part(wheel(radius - half, 0, low + radius, radius, 0.05), STEEL, porosity=0.65),
        Part(block((0, 0, low + 0.6), (0.9 * half, 0.06, 0.35)), STEEL, porosity=0.5),
        Part(block((0.5 * half, 0, low + 0.62 * height), (0.06, max(width - 0.06, 0.3), 0.08)),
             STEEL),
        Part(torso, cloth),
        Part(column(0.1, 0.11, low + 0.25, seat, 0.11, 0.07), cloth),
        Part(column(0.0, -0.11, low + 0.1, seat, 0.11, 0.07), cloth),
        Part(column(0.1, 0, low + 0.86 * height, height / 2 - 0.01, 0.11, 0.09), SKIN),
    ]  # fmt: skip
    return assemble(parts)
