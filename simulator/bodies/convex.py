"""Rays against bodies made of convex parts (intersections of half-spaces).

Letters: R rays, P parts, K planes a part.
"""

from dataclasses import dataclass

import numpy as np

from simulator.config import RETURNS

FAR = np.float32(1e9)
FEW = 1500  # rays times parts below which culling is slower than none


@dataclass(frozen=True)
class Body:
    """A union of convex parts in the box's own frame: x forward, y left, z up, origin at centre.

    planes (P, K, 4) f32: a point p is inside a part if n . p <= d for its K planes (n unit or 0);
    reflectivity, gloss (P,) f32 (a glossy part returns little light at oblique incidence:
    power falls with cosine ** (power * (1 + gloss)));
    interior (P,) bool: seen through glass only;
    porosity (P,) f32: share of rays that pass (spokes, frames);
    glass (P, K) bool: faces with window panes;
    pane (4,) f32: x from, x to, z from, z to within which a glass face is glass (else paint);
    pillars (n,) f32: x of the pillars that divide the side windows;
    spheres (P, 4) f32: centre and radius of a ball around each part.
    """

    planes: np.ndarray
    reflectivity: np.ndarray
    gloss: np.ndarray
    interior: np.ndarray
    porosity: np.ndarray
    glass: np.ndarray
    pane: np.ndarray
    pillars: np.ndarray
    spheres: np.ndarray


def intersect(planes, origin, direction):
    """First hit of each ray with each convex part.

    planes (P, K, 4), origin (R, 3), direction (R, 3) unit. Returns distance (R, P) f32 (FAR where
    missed) and face (R, P) int: the plane through which the ray enters. Rays that start inside
    miss.
    """
    parts, count = planes.shape[:2]
    normals = planes[..., :3].reshape(-1, 3)
    speed = normals @ direction.T  # (P K, R): sums over planes run along contiguous rays
    # A ray along a plane counts as leaving it slowly: far ahead if inside, far behind if not.
    speed[np.abs(speed) < 1e-7] = 1e-7
    step = (planes[..., 3].reshape(-1, 1) - normals @ origin.T) / speed
    inwards = speed < 0
    enter = np.where(inwards, step, -FAR).reshape(parts, count, -1)
    leave = np.where(inwards, FAR, step).reshape(parts, count, -1)
    near = enter.max(axis=1)
    hit = (near > 0) & (near < leave.min(axis=1))
    face = np.zeros(near.shape, np.int64)
    part, ray = np.nonzero(hit)
    face[part, ray] = enter[part, :, ray].argmax(axis=1)
    return np.where(hit, near, FAR).astype(np.float32).T, face.T


def intersect_body(body: Body, origin, direction):
    """`intersect` over all parts of `body`, for each part with the rays near it."""
    rays, parts = len(origin), len(body.planes)
    if rays * parts < FEW:
        return intersect(body.planes, origin, direction)
    distance = np.full((rays, parts), FAR, np.float32)
    face = np.zeros((rays, parts), np.int64)
    centers, radii = body.spheres[:, :3], body.spheres[:, 3]
    start = (origin * origin).sum(axis=1) - 2 * centers @ origin.T
    along = centers @ direction.T - (origin * direction).sum(axis=1)
    reach = (radii**2 - (centers * centers).sum(axis=1))[:, None]
    close = start - along * along < reach + np.float32(0.01)  # (P, R); float32 cancels
    for index in range(parts):
        near = np.flatnonzero(close[index])
        if len(near):
            found = intersect(body.planes[index : index + 1], origin[near], direction[near])
            distance[near, index], face[near, index] = found[0][:, 0], found[1][:, 0]
    return distance, face


def to_box_frame(box, origin, direction):
    """Rays (R, 3) in the frame of `box` (7,), (x, y, z, l, w, h, yaw)."""
    cos, sin = np.float32(np.cos(box[6])), np.float32(np.sin(box[6]))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], np.float32)
    return (origin - np.asarray(box[:3], np.float32)) @ turn, direction @ turn


@dataclass(frozen=True)
class BodyHits:
    """Hits of rays (R,) on a body.

    outline (R,) f32: distance at which the ray meets the body at all (FAR where it misses);
    distance (R,) f32: distance of the return, FAR where the ray passes through;
    reflectivity (R,) f32, 0 where the ray is absorbed; cosine (R,) f32 of the incidence, to the
    power of 1 + gloss.
    """

    outline: np.ndarray
    distance: np.ndarray
    reflectivity: np.ndarray
    cosine: np.ndarray


def cast_body(body: Body, origin, direction, rng) -> BodyHits:
    """Rays (R, 3) in the body's frame against its parts, window panes included.

    A ray that meets a pane is returned, lost, or continues to the seats; it passes through the body
    where it misses them.
    """
    distance, face = intersect_body(body, origin, direction)
    distance = np.where(_holes(body, len(origin), rng), FAR, distance)
    shell = np.where(body.interior[None], FAR, distance)
    part = shell.argmin(axis=1)
    rows = np.arange(len(part))
    outline = shell[rows, part]
    reflectivity = body.reflectivity[part].copy()
    met = outline < FAR
    result = outline.copy()
    glass = met & body.glass[part, face[rows, part]]
    if glass.any():
        index = np.flatnonzero(glass)
        points = origin[index] + direction[index] * outline[index, None]
        index = index[_on_pane(body, points)]
        draw = rng.random(len(index))
        inner = np.where(body.interior[None], distance[index], FAR)
        seat = inner.argmin(axis=1)
        depth = inner[np.arange(len(index)), seat]
        seen = (depth < FAR) & (draw > RETURNS.glass_surface + RETURNS.glass_absorbed)
        gone = (depth >= FAR) & (draw > RETURNS.glass_surface + RETURNS.glass_absorbed)
        lost = (draw > RETURNS.glass_surface) & ~seen & ~gone
        kept = rng.random(len(index)) < RETURNS.interior_return
        reflectivity[index] = np.where(lost | (seen & ~kept), 0, reflectivity[index])
        result[index[seen]] = depth[seen]
        result[index[gone]] = FAR
        reflectivity[index[seen & kept]] = body.reflectivity[seat[seen & kept]]
        part[index[seen]] = seat[seen]
    cosine = np.abs(np.einsum("ij,ij->i", body.planes[part, face[rows, part], :3], direction))
    cosine **= 1 + body.gloss[part]
    return BodyHits(outline, result, reflectivity, cosine)


def _holes(body: Body, rays: int, rng) -> np.ndarray:
    if not body.porosity.any():
        return np.zeros((1, len(body.porosity)), bool)
    return rng.random((rays, len(body.porosity))) < body.porosity


def _on_pane(body: Body, points) -> np.ndarray:
    x_low, x_high, z_low, z_high = body.pane
    x, z = points[:, 0], points[:, 2]
    inside = (x > x_low) & (x < x_high) & (z > z_low) & (z < z_high)
    for pillar in body.pillars:
        inside &= np.abs(x - pillar) > 0.06
    return inside
