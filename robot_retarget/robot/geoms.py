"""Which geoms of a robot collide, and which pairs of links may touch."""

import copy
import itertools

import mujoco
import numpy as np

from robot_retarget.robot.model import Robot

Table = dict[tuple[int, int], list[tuple[int, int]]]
"""Pairs of geoms by pair of links."""


def collision_geoms(robot: Robot) -> dict[int, list[int]]:
    """Return the colliding geoms of every link: by contact type, or from an explicit pair.

    A model in which no two links can touch uses its visual geoms (`shapes_stand_in`).
    """
    model = robot.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    touching[[*model.pair_geom1, *model.pair_geom2]] = True
    return _by_link(model, touching | shapes_stand_in(robot))


def solid_geoms(robot: Robot) -> dict[int, list[int]]:
    """Return the solid geoms of every link: the colliding ones, or all geoms of a link without any."""
    return _by_link(robot.model, np.ones(robot.model.ngeom, dtype=bool)) | collision_geoms(robot)


def shapes_stand_in(robot: Robot) -> bool:
    """Return whether visual geoms replace collision geoms: the model has no colliding types and no explicit pair of links."""
    model = robot.model
    link = np.asarray(model.body_weldid)[model.geom_bodyid]
    by_type = ((model.geom_contype | model.geom_conaffinity) != 0) & (link > 0)
    first, second = link[model.pair_geom1], link[model.pair_geom2]
    return not (by_type.any() or ((first > 0) & (second > 0)).any())


def touchable(robot: Robot) -> mujoco.MjModel:
    """Return the model, or a copy in which visual geoms collide if they replace collision geoms."""
    if not shapes_stand_in(robot):
        return robot.model
    model = copy.deepcopy(robot.model)
    own = np.asarray(model.body_weldid)[model.geom_bodyid] > 0
    model.geom_contype[own] = model.geom_conaffinity[own] = 1
    model.body_contype[:] = model.body_conaffinity[:] = (
        np.asarray(model.body_weldid) > 0
    )  # the broad phase uses the types of bodies
    return model


def _by_link(model: mujoco.MjModel, chosen: np.ndarray) -> dict[int, list[int]]:
    link, found = np.asarray(model.body_weldid)[model.geom_bodyid], {}
    for geom in np.flatnonzero(chosen & (link > 0)):
        found.setdefault(int(link[geom]), []).append(int(geom))
    return dict(sorted(found.items()))


def allowed(robot: Robot) -> Table:
    """Return the pairs of geoms (a < b) of every pair of links that pass the model's contact filter."""
    model = robot.model
    link = np.asarray(model.body_weldid)
    carrier = link[model.body_parentid[link]]
    shut = {tuple(sorted((int(code) >> 16, int(code) & 0xFFFF))) for code in model.exclude_signature}
    explicit = {tuple(sorted(map(int, pair))) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    solid = [g for geoms in collision_geoms(robot).values() for g in geoms]
    stand_in = shapes_stand_in(robot)
    listed = explicit | set(itertools.combinations(sorted(solid), 2))
    table: Table = {}
    for a, b in sorted(listed):
        bodies = int(model.geom_bodyid[a]), int(model.geom_bodyid[b])
        first, second = sorted(int(link[body]) for body in bodies)
        related = carrier[first] == second or carrier[second] == first
        types = (model.geom_contype[a] & model.geom_conaffinity[b]) | (
            model.geom_contype[b] & model.geom_conaffinity[a]
        )
        let_through = (types or stand_in) and not related and tuple(sorted(bodies)) not in shut
        if first != second and first > 0 and (let_through or (a, b) in explicit):
            table.setdefault((first, second), []).append((a, b))
    return table
