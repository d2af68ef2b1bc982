"""Bodies of vehicles: hatchback, saloon, estate, SUV, van, truck, tram, scaled to a labelled box.

Box frame: x forward, y left, z up, origin at the centre. Bodies leave the median slack of the
vehicles of sequence 0000 in their boxes: 2 cm along, 5 cm at a side, 8 cm on top.
"""

from dataclasses import dataclass

import numpy as np

from simulator.bodies.convex import Body
from simulator.bodies.parts import (
    Pane,
    Part,
    assemble,
    block,
    corner_planes,
    profile_planes,
    side_planes,
    wheel,
)

# Side profile of each style as shares of length (from the front) and of height:
# bonnet front height, cowl x, cowl height, roof front x, roof rear x, tail x, tail height.
PROFILES = {
    "hatchback": (0.50, 0.27, 0.63, 0.44, 0.86, 0.98, 0.64),
    "saloon": (0.47, 0.29, 0.62, 0.45, 0.72, 0.86, 0.66),
    "estate": (0.47, 0.28, 0.61, 0.44, 0.90, 0.98, 0.63),
    "suv": (0.54, 0.25, 0.62, 0.38, 0.90, 0.98, 0.62),
}
RUBBER, CLOTH = 0.06, 0.12


@dataclass(frozen=True)
class Paint:
    """A car's paint at 905 nm: reflectivity and gloss (see `Body`).

    Kinds and shares were chosen by hand after sequence 0000: about half of its cars return
    intensities near zero, and a quarter lose a third or more of their points to dark, glossy paint.
    """

    reflectivity: float
    gloss: float

    def part(self, planes, glass=()) -> Part:
        """A painted part."""
        return Part(planes, self.reflectivity, gloss=self.gloss, glass=glass)


def paint(rng) -> Paint:
    """A random paint: dark and glossy, metallic, or light."""
    low, high, gloss = ((0.015, 0.05, 3.0), (0.06, 0.30, 1.5), (0.35, 0.80, 0.5))[
        rng.choice(3, p=[0.35, 0.35, 0.30])
    ]
    return Paint(float(rng.uniform(low, high)), gloss)


def style_of(length: float, height: float, rng) -> str:
    """A random body style for a car of this length and height."""
    if height > 1.62:
        return "suv"
    if length < 3.95:
        return "hatchback"
    return str(rng.choice(["saloon", "estate", "hatchback"], p=[0.5, 0.3, 0.2]))


def car(size, rng, style: str | None = None) -> Body:
    """A passenger car of `size` (l, w, h) metres."""
    length, width, height = (float(value) for value in size)
    style = style or style_of(length, height, rng)
    nose, cowl_x, cowl_z, roof_x, roof_end, tail_x, tail_z = PROFILES[style]
    half, side = length / 2 - 0.02, width / 2 - 0.04
    low, top = -height / 2, height / 2 - 0.05

    def at(share_x, share_z):
        return half - share_x * 2 * half, low + share_z * height

    color = paint(rng)
    clearance = 0.16 if style != "suv" else 0.2
    belt = [
        at(0.03, clearance), at(0.0, 0.30), at(0.02, nose), at(cowl_x, cowl_z),
        at(tail_x if style == "saloon" else 0.97, tail_z), at(1.0, 0.5), at(0.97, clearance),
    ]  # fmt: skip
    hull = np.vstack(
        [profile_planes(belt), side_planes(side, low + 0.4 * height, 0.06),
         corner_planes(half, -half, side, 0.24 * width)]
    )  # fmt: skip
    roof = [
        at(cowl_x - 0.01, cowl_z - 0.02), (at(roof_x, 1.0)[0], top),
        (at(roof_end, 1.0)[0], top - 0.04), at(tail_x, tail_z - 0.02),
    ]  # fmt: skip
    cabin = np.vstack([profile_planes(roof), side_planes(side - 0.01, low + 0.6 * height, 0.28)])
    belt_z = low + cowl_z * height + 0.03
    front, rear = at(cowl_x, 0)[0], at(tail_x, 0)[0]
    parts = [
        color.part(hull),
        color.part(cabin, (0, 2, 4, 5)),
        Part(block(((front + rear) / 2 - 0.1, 0, belt_z - 0.15),
                   (max(0.5 * (front - rear), 0.5), width - 0.5, 0.7), 0.7), CLOTH, interior=True),
    ]  # fmt: skip
    parts += _wheels(half, side, low, 0.205 * height if style != "suv" else 0.21 * height)
    parts += _mirrors(front - 0.25, width / 2, belt_z + 0.05)
    pane = Pane(z=(belt_z, top - 0.09), pillars=((front + rear) / 2, (front + 3 * rear) / 4 - 0.1))
    return assemble(parts, pane)


def van(size, rng) -> Body:
    """A van or minibus of `size` (l, w, h) metres: short sloping nose, high straight back."""
    length, width, height = (float(value) for value in size)
    half, side = length / 2 - 0.02, width / 2 - 0.05
    low, top = -height / 2, height / 2 - 0.06
    color = paint(rng)
    nose = 0.16 * length
    screen = half - nose
    cabin = [
        (screen, low + 0.25), (screen, low + 0.56 * height), (screen - 0.2 * height, top),
        (-half + 0.08, top - 0.03), (-half, low + 0.5 * height), (-half + 0.04, low + 0.22),
    ]  # fmt: skip
    bonnet = [
        (half - 0.05, low + 0.2), (half, low + 0.3 * height), (half - 0.05, low + 0.44 * height),
        (screen, low + 0.55 * height), (screen - 0.2, low + 0.55 * height),
        (screen - 0.2, low + 0.2),
    ]  # fmt: skip
    sides = side_planes(side, low + 0.45 * height, 0.05)
    corners = corner_planes(half, -half, side, 0.22 * width)
    hull = np.vstack([profile_planes(cabin), sides, corners])
    front = np.vstack([profile_planes(bonnet), sides, corners])
    windows = rng.random() < 0.65  # minibus with windows all along, or delivery van
    rear = -half if windows else screen - 1.1
    panes = (1, 6, 7, 3) if windows else (1, 6, 7)
    parts = [color.part(hull, panes), color.part(front)]
    seat = block((screen - 0.9, 0, low + 0.45 * height), (0.7, width - 0.5, 0.5 * height), 0.8)
    parts.append(Part(seat, CLOTH, interior=True))
    parts += _wheels(half, side, low, 0.33)
    parts += _mirrors(screen - 0.1, width / 2, low + 0.6 * height)
    pillars = (screen - 1.1, 0.0, -half + 0.3)
    pane = Pane(x=(rear, half), z=(low + 0.57 * height, top - 0.14), pillars=pillars)
    return assemble(parts, pane)


def truck(size, rng) -> Body:
    """A lorry of `size` (l, w, h) metres: cab, load box, wheels."""
    length, width, height = (float(value) for value in size)
    half, side, low = length / 2 - 0.02, width / 2 - 0.03, -height / 2
    cab = min(2.0, 0.3 * length)
    cab_top = low + height * float(rng.uniform(0.75, 0.95))
    profile = [
        (half, low + 0.4), (half, low + 0.45 * height), (half - 0.2, cab_top),
        (half - cab, cab_top), (half - cab, low + 0.4),
    ]  # fmt: skip
    cabin = np.vstack([profile_planes(profile), side_planes(side, 0, 0.03)])
    load = block(
        (-cab / 2 - 0.15, 0, low + 0.5 * (height + 0.95)),
        (2 * half - cab - 0.3, 2 * side, height - 0.95),
    )
    frame = block((0, 0, low + 0.75), (2 * half - 0.2, 0.8 * side, 0.45))
    color = paint(rng)
    parts = [
        color.part(cabin, (1, 5, 6)),
        Part(load, float(rng.uniform(0.2, 0.8))),
        Part(frame, 0.1),
        Part(block((half - cab + 0.5, 0, low + 0.5 * height), (0.5, side, 0.3 * height)), CLOTH,
             interior=True),
    ]  # fmt: skip
    parts += _wheels(half, side, low, 0.48)
    pane = Pane(x=(half - cab + 0.3, half), z=(low + 0.5 * height, cab_top - 0.2))
    return assemble(parts, pane)


def tram(size, rng) -> Body:
    """A tram of `size` (l, w, h) metres: one long body with windows."""
    length, width, height = (float(value) for value in size)
    low = -height / 2
    hull = np.vstack(
        [block((0, 0, 0.15), (length - 0.1, width - 0.1, height - 0.4)),
         corner_planes(length / 2, -length / 2, width / 2, 0.2 * width)]
    )  # fmt: skip
    pillars = tuple(np.arange(-length / 2 + 1, length / 2, 1.6))
    pane = Pane(z=(low + 0.42 * height, low + 0.75 * height), pillars=pillars)
    seats = block((0, 0, low + 0.35 * height), (length - 2, width - 0.8, 0.3 * height))
    parts = [Part(hull, 0.4, glass=(0, 1, 2, 3)), Part(seats, CLOTH, interior=True)]
    return assemble(parts, pane)


def misc(size, rng) -> Body:
    """Any other vehicle, such as a trailer: a block on wheels."""
    length, width, height = (float(value) for value in size)
    body = block((0, 0, 0.15), (length - 0.05, width - 0.05, height - 0.35), 0.9)
    wheels = _wheels(length / 2, width / 2 - 0.05, -height / 2, min(0.3, 0.2 * height))
    return assemble([Part(body, float(rng.uniform(0.1, 0.6))), *wheels])


def _wheels(half: float, side: float, low: float, radius: float) -> list[Part]:
    return [
        Part(wheel(x, y, low + radius, radius, 0.2), RUBBER + 0.1)
        for x in (0.62 * half, -0.60 * half)
        for y in (side - 0.09, -side + 0.09)
    ]


def _mirrors(x: float, side: float, z: float) -> list[Part]:
    return [Part(block((x, y, z), (0.16, 0.18, 0.14)), 0.15) for y in (side - 0.03, -side + 0.03)]
