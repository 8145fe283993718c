"""Measure the distance geometry core: `python scripts/bench/bench_dgp.py` prints a table. One core, best of several runs.

Set OMP_NUM_THREADS=1 to keep the linear algebra on one core too.
"""

import time
from collections.abc import Callable

import numpy as np

from robot_retarget.papers import Ipopt, adapt, frame_edges, interaction_distance, solve, solve_frames
from robot_retarget.papers.branch import branch_and_prune
from robot_retarget.papers.skeletal import posture_cases, realize, resized, table_one_body


def best(run: Callable[[], object], repeats: int = 7) -> float:
    """The shortest of several wall times [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


def interaction_rows() -> list[tuple[str, str]]:
    rng = np.random.default_rng(0)
    before = rng.normal(size=(10_000, 22, 3))
    now = before + 0.02 * rng.normal(size=before.shape)
    pairs = 10_000 * 231
    rows = []
    for horizon in (None, 15):
        seconds = best(lambda horizon=horizon: interaction_distance(before, now, horizon=horizon))
        rows.append(
            (f"D and α, 22 joints × 10,000 frames, horizon {horizon}", f"{pairs / seconds / 1e7:.1f}·10⁷ pairs/s")
        )
    one = best(lambda: interaction_distance(before[0], now[0], horizon=15), 200)
    return [*rows, ("D and α, 22 joints, one frame", f"{one * 1e6:.0f} µs")]


def posture_rows() -> list[tuple[str, str]]:
    body, rows = table_one_body(), []
    posture = body.initial_pose
    graphs = [adapt(posture, body, resized(body, factors)) for factors in posture_cases().values()]
    spent = [best(lambda graph=graph: solve(graph, posture)) for graph in graphs]
    figure = f"{np.mean(spent) * 1e3:.1f} ms mean, {np.max(spent) * 1e3:.1f} ms worst"
    rows.append(("one 22-joint posture, 13 bodies, spectral, the papers' tolerances", figure))
    seconds = best(lambda: solve(graphs[1], posture, Ipopt()), 3)
    rows.append(("one 22-joint posture, hard bones, IPOPT with its building", f"{seconds * 1e3:.0f} ms"))
    build = best(lambda: adapt(posture, body, resized(body, posture_cases()["arms +20 %"])))
    return [*rows, ("building one posture's graph", f"{build * 1e3:.1f} ms")]


def batch_rows() -> list[tuple[str, str]]:
    body, rng = table_one_body(), np.random.default_rng(1)
    turns = np.cumsum(0.02 * rng.normal(size=(1000, 22, 3)), axis=0)
    postures, rows = realize(body, turns, np.zeros((1000, 3))), []
    for case in ("arms +20 %", "legs +60 %", "child-like"):
        graph = adapt(postures, body, resized(body, posture_cases()[case]))
        found = [solve_frames(graph, postures) for _ in range(3)]
        assert found[0].converged
        seconds = min(solution.seconds for solution in found)
        figure = f"{seconds:.2f} ms each, {np.mean(found[0].iterations):.0f} iterations"
        rows.append((f"1,000 postures side by side, {case}", figure))
    return rows


def tree_rows() -> list[tuple[str, str]]:
    rng = np.random.default_rng(2)
    body = table_one_body()
    complete = frame_edges(body.names, realize(body, rng.uniform(-0.5, 0.5, (1, 22, 3)), np.zeros((1, 3)))[0])
    chain = frame_edges(tuple(str(v) for v in range(12)), rng.normal(size=(12, 3)))
    chain = chain.select(np.abs(chain.edges.i - chain.edges.j) <= 3)
    return [
        ("branch and prune, complete 22-joint posture, 2 solutions", f"{best(lambda: branch_and_prune(complete)) * 1e3:.1f} ms"),
        ("branch and prune, chain of 12, 512 solutions", f"{best(lambda: branch_and_prune(chain), 3) * 1e3:.0f} ms"),
    ]  # fmt: skip


def main() -> None:
    """Print the table."""
    print("| what | measured |\n| --- | --- |")
    for rows in (interaction_rows, posture_rows, batch_rows, tree_rows):
        for what, figure in rows():
            print(f"| {what} | {figure} |", flush=True)


if __name__ == "__main__":
    main()
