"""The public instance format of distance geometry, `.nmr`: one distance a line, blanks between the fields.

    4 fields   Id1 Id2 lb ub                                                        sensor networks
    8 fields   Id1 Id2 lb ub Name1 Name2 groupName1 groupName2                      format 0.2
    10 fields  Id1 Id2 groupId1 groupId2 lb ub Name1 Name2 groupName1 groupName2    format 0.3

Ids are consecutive; the smallest one is arbitrary and becomes vertex 0.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.dgp.build import listed_edges
from robot_retarget.dgp.points import PointGraph
from robot_retarget.errors import GraphError, UsageError
from robot_retarget.files import replacing

FORMATS = {"sensors": 4, "0.2": 8, "0.3": 10}


@dataclass(frozen=True)
class Label:
    """The data of a vertex in an instance file, such as an atom and its residue."""

    name: str = ""
    group: int = 0
    group_name: str = ""


@dataclass(frozen=True)
class Instance:
    """A graph of one frame in dimension 3 whose vertices are named by their ids, with the labels of the file."""

    graph: PointGraph
    labels: tuple[Label, ...]


@dataclass(frozen=True)
class _Row:
    ends: tuple[int, int]
    lower: float
    upper: float
    labels: tuple[Label, Label]


def read_nmr(path: str | Path) -> Instance:
    """Read an instance; the number of fields determines the format.

    Raises:
        GraphError: the file cannot be read, or a line is wrong (the message names file and line).
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise GraphError(f"cannot read {path}: {error}") from error
    rows = [_row(line.split(), f"{path}:{number}") for number, line in enumerate(lines, 1) if line.strip()]
    if not rows:
        raise GraphError(f"{path}: no distances")
    ids = np.array([row.ends for row in rows])
    first, last = int(ids.min()), int(ids.max())
    missing = np.setdiff1d(np.arange(first, last + 1), ids)
    if missing.size:
        raise GraphError(f"{path}: ids must be consecutive, {missing[0]} is missing between {first} and {last}")
    labels = {end: label for row in rows for end, label in zip(row.ends, row.labels, strict=True)}
    names = tuple(str(vertex) for vertex in range(first, last + 1))
    lower, upper = (np.array([getattr(row, name) for row in rows]) for name in ("lower", "upper"))
    i, j = (ids - first).T
    graph = listed_edges(names, 3, i, j, lower, upper)
    return Instance(graph, tuple(labels[vertex] for vertex in range(first, last + 1)))


def _row(fields: list[str], where: str) -> _Row:
    if len(fields) not in FORMATS.values():
        raise GraphError(f"{where}: {len(fields)} fields; a distance has 4 (sensors), 8 (0.2) or 10 (0.3)")
    groups = (0, 0)
    try:
        ends = int(fields[0]), int(fields[1])
        if len(fields) == 10:
            groups, fields = (int(fields[2]), int(fields[3])), fields[:2] + fields[4:]
        lower, upper = float(fields[2]), float(fields[3])
    except ValueError as error:
        raise GraphError(f"{where}: {error}") from None
    if not 0 <= lower <= upper or ends[0] == ends[1] or min(ends) < 0:
        raise GraphError(f"{where}: needs two different ids ≥ 0 and 0 ≤ lower ≤ upper, got {' '.join(fields[:4])}")
    names = fields[4:] or [""] * 4
    labels = Label(names[0], groups[0], names[2]), Label(names[1], groups[1], names[3])
    return _Row(ends, lower, upper, labels)


def write_nmr(instance: Instance, path: str | Path, format: str = "0.3") -> None:
    """Write an instance so that reading it gives the same graph, to the last bit.

    Raises:
        UsageError: the format is unknown, or it has names and a vertex has none.
        OutputError: the file cannot be written.
    """
    if format not in FORMATS:
        raise UsageError(f"format must be one of {', '.join(FORMATS)}, got {format!r}")
    if format != "sensors":
        for vertex, label in zip(instance.graph.vertices, instance.labels, strict=True):
            if not (label.name and label.group_name):
                raise UsageError(f"vertex {vertex} has no name and group; write format 'sensors'")
    graph, edges, lines = instance.graph, instance.graph.edges, []
    for i, j, lower, upper in zip(edges.i, edges.j, edges.lower, edges.upper, strict=True):
        a, b = instance.labels[i], instance.labels[j]
        groups = [str(a.group), str(b.group)] if format == "0.3" else []
        names = [] if format == "sensors" else [a.name, b.name, a.group_name, b.group_name]
        bounds = [repr(float(lower)), repr(float(upper))]
        lines.append(" ".join([graph.vertices[i], graph.vertices[j], *groups, *bounds, *names]))
    with replacing(path) as scratch:
        scratch.write_text("\n".join(lines) + "\n", encoding="utf-8")
