"""Instance files: what is written is read again, and a wrong line is named."""

from pathlib import Path

import numpy as np
import pytest

from robot_retarget.dgp import Instance, Label, frame_edges, read_nmr, write_nmr
from robot_retarget.errors import GraphError, UsageError

RNG = np.random.default_rng(17)


def instance(count: int = 6, first: int = 5) -> Instance:
    x = RNG.normal(size=(count, 3))
    graph = frame_edges(tuple(str(first + vertex) for vertex in range(count)), x)
    labels = tuple(Label(f"C{vertex}", vertex // 3, "GLY") for vertex in range(count))
    return Instance(graph, labels)


@pytest.mark.parametrize("format", ["sensors", "0.2", "0.3"])
def test_reading_gives_back_what_was_written(format: str, tmp_path: Path) -> None:
    written, path = instance(), tmp_path / "small.nmr"
    write_nmr(written, path, format)
    read = read_nmr(path)
    for column in ("i", "j", "lower", "upper"):
        np.testing.assert_array_equal(getattr(read.graph.edges, column), getattr(written.graph.edges, column))
    assert read.graph.vertices == ("5", "6", "7", "8", "9", "10")
    if format == "0.3":
        assert read.labels == written.labels
    if format == "0.2":
        assert [label.name for label in read.labels] == [label.name for label in written.labels]


def test_fields_stand_where_the_formats_put_them(tmp_path: Path) -> None:
    path = tmp_path / "two.nmr"
    path.write_text("1 2 1.5 2.5 N CA ALA GLY\n\n1  3  7 9  3.0 3.0  N C  ALA SER\n")
    read = read_nmr(path)
    assert read.graph.edges.lower.tolist() == [1.5, 3.0]
    assert read.graph.edges.upper.tolist() == [2.5, 3.0]
    assert read.labels == (Label("N", 7, "ALA"), Label("CA", 0, "GLY"), Label("C", 9, "SER"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 1.0 1.0\n1 3 1.0\n", r"bad\.nmr:2: 3 fields"),
        ("1 2 1.0 x\n", r"bad\.nmr:1: could not convert string to float: 'x'"),
        ("1 b 1.0 1.0\n", r"bad\.nmr:1: invalid literal"),
        ("1 2 2.0 1.0\n", r"bad\.nmr:1: needs .* 0 ≤ lower ≤ upper"),
        ("1 2 nan 1.0\n", r"bad\.nmr:1: needs"),
        ("1 2 -1.0 1.0\n", r"bad\.nmr:1: needs"),
        ("1 1 1.0 1.0\n", r"bad\.nmr:1: needs two different ids"),
        ("1 2 1.0 1.0\n4 5 1.0 1.0\n", r"ids must be consecutive, 3 is missing between 1 and 5"),
        ("\n", r"bad\.nmr: no distances"),
    ],
)
def test_wrong_line_is_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.nmr"
    path.write_text(text)
    with pytest.raises(GraphError, match=message):
        read_nmr(path)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(GraphError, match=r"cannot read .*none\.nmr"):
        read_nmr(tmp_path / "none.nmr")


def test_unknown_format_and_nameless_vertices_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"one of sensors, 0\.2, 0\.3, got '9'"):
        write_nmr(instance(), tmp_path / "x.nmr", "9")
    bare = Instance(instance().graph, tuple(Label() for _ in range(6)))
    with pytest.raises(UsageError, match="vertex 5 has no name"):
        write_nmr(bare, tmp_path / "x.nmr")
