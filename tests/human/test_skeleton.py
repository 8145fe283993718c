"""A skeleton gives the positions of its joints at rest and the directions of its limbs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.base.arrays import Ints
from robot_retarget.human.skeleton import Skeleton


def way(parents: Ints, joint: int, carried: int) -> list[int]:
    """The joints after one down to another that it carries."""
    return [] if carried == joint else [*way(parents, joint, int(parents[carried])), carried]


def carries(parents: Ints, joint: int, other: int) -> bool:
    return other == joint or (other >= 0 and carries(parents, joint, int(parents[other])))


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.lists(st.integers(-3, 3), min_size=3, max_size=3)), min_size=1, max_size=12
    )
)
def test_outward_is_the_first_step_on_the_way_to_what_stands_farthest_at_rest(
    joints: list[tuple[int, list[int]]],
) -> None:
    parents = np.array([-1] + [min(parent, k) for k, (parent, _) in enumerate(joints)])
    offsets = np.array([[0, 0, 0]] + [offset for _, offset in joints], dtype=float)
    skeleton = Skeleton(tuple(f"j{k}" for k in range(len(parents))), parents, offsets)
    for joint in range(len(parents)):
        assert np.allclose(skeleton.rest()[joint], offsets[[0, *way(parents, 0, joint)]].sum(axis=0))
        ways = [way(parents, joint, k) for k in range(len(parents)) if carries(parents, joint, k)]
        reach = [np.linalg.norm(offsets[w].sum(axis=0)) for w in ways]
        farthest = [w for w, r in zip(ways, reach, strict=True) if r > max(reach) - 1e-9]
        steps = [next((offsets[k] for k in w if offsets[k].any()), np.zeros(3)) for w in farthest]
        assert any(np.array_equal(skeleton.outward(joint), step) for step in steps)
