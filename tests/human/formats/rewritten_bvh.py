"""The same BVH file in another rotation order, unit and up axis, by a reader of its own that knows nothing of the package."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Node:
    """A joint, or an end site without channels."""

    head: str
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels: list[str] = field(default_factory=list)
    children: list["Node"] = field(default_factory=list)


def rewritten(path: Path, order: str, scale: float, turn: np.ndarray) -> str:
    """The text of a file whose joints turn in `order` (`ZXY`), its lengths times `scale`, its axes turned by (3, 3) `turn`."""
    words = iter(path.read_text(errors="replace").split())
    assert next(words) == "HIERARCHY"
    roots, word = [], next(words)
    while word != "MOTION":
        roots.append(_node(words, f"{word} {next(words)}"))
        word = next(words)
    assert next(words) == "Frames:"
    count = int(next(words))
    step = [next(words) for _ in range(3)][-1]
    rows = np.array(list(words), dtype=float).reshape(count, -1)
    columns: list[np.ndarray] = []
    place, text = 0, ["HIERARCHY"]
    for root in roots:
        place = _write(root, rows, place, (order, scale, turn), columns, text)
    lines = [" ".join(f"{value:.8f}" for value in row) for row in np.concatenate(columns, axis=1)]
    return "\n".join([*text, "MOTION", f"Frames: {count}", f"Frame Time: {step}", *lines, ""])


def _node(words, head: str) -> Node:
    node = Node(head)
    assert next(words) == "{"
    while (word := next(words)) != "}":
        if word == "OFFSET":
            node.offset = np.array([float(next(words)) for _ in range(3)])
        elif word == "CHANNELS":
            node.channels = [next(words) for _ in range(int(next(words)))]
        else:
            node.children.append(_node(words, f"{word} {next(words)}"))
    return node


def _write(node: Node, rows, place: int, told, columns: list, text: list[str]) -> int:
    order, scale, turn = told
    own = dict(zip(node.channels, rows[:, place : place + len(node.channels)].T, strict=True))
    place += len(node.channels)
    moves = [f"{axis}position" for axis in "XYZ" if f"{axis}position" in own]
    turns = [name for name in node.channels if name.endswith("rotation")]
    channels = []
    if moves:
        assert len(moves) == 3
        columns.append(scale * np.stack([own[name] for name in moves], axis=1) @ turn.T)
        channels += moves
    if turns:
        matrix = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        for name in turns:
            matrix = matrix @ Rotation.from_euler(name[0], own[name][:, None], degrees=True).as_matrix()
        turned = Rotation.from_matrix(turn @ matrix @ turn.T)
        columns.append(turned.as_euler(order, degrees=True))
        channels += [f"{axis}rotation" for axis in order]
    offset = " ".join(f"{value:.8f}" for value in scale * turn @ node.offset)
    text += [node.head, "{", f"OFFSET {offset}"]
    if channels:
        text.append(f"CHANNELS {len(channels)} {' '.join(channels)}")
    for child in node.children:
        place = _write(child, rows, place, told, columns, text)
    text.append("}")
    return place
