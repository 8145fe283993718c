"""Regenerate the figures and tables of the distance geometry papers: `python scripts/figures/reproduce_papers.py`.

Writes PNGs to docs/papers/ and the table of what the papers say and what comes out here between the marks of
benchmarks/papers.md. `--only NAME …` limits it to some figures, `--out DIR` writes pictures and a table elsewhere.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import paper_plots as draw
from paper_instances import lifted_starts, nearest_realization, sensor_network, stiff_mesh
from paper_scenes import (
    Crowd,
    clock,
    crossing,
    figure,
    meeting,
    pedestrians,
    raised_hands,
    shortened_arms,
    team,
    together,
)
from reproduce_interaction import Row, anticipation, clap, online, two_constraints

from robot_retarget.papers import (
    Ipopt,
    Objective,
    Sensing,
    SkeletalStructure,
    Team,
    adapt,
    bone_edges,
    distances,
    formation_rigidity,
    frame_edges,
    multistart,
    solve,
    solve_formation,
    solve_with_thresholds,
    stress,
    transfer_directions,
)
from robot_retarget.papers.branch import Branching, branch_and_prune
from robot_retarget.papers.formation import links
from robot_retarget.papers.skeletal import posture_cases, resized, table_one_body
from robot_retarget.papers.solvers import PointSolution

DOCS = Path(__file__).resolve().parents[2] / "docs"
START, END = "<!-- reproduced: start -->", "<!-- reproduced: end -->"

papers = partial(solve, objective=Objective.HALF_SQUARED)


def closest(scene: Crowd, threshold: float, x: np.ndarray) -> float:
    """The least distance of a guarded pair over all frames [m]."""
    return float(distances(scene.thresholds(threshold), x).min())


def drift(scene: Crowd, x: np.ndarray) -> float:
    """How far the first and last frame moved [m]."""
    return float(np.linalg.norm(x[[0, -1]] - scene.animation[[0, -1]], axis=-1).max())


def anchored(scene: Crowd, threshold: float) -> tuple[PointSolution, PointSolution]:
    """The papers' method with free ends, and hard thresholds with the first and last frame held."""
    base, candidates = scene.traces(False), scene.thresholds(threshold)
    free = solve_with_thresholds(base, candidates, scene.animation, papers)
    held = solve_with_thresholds(scene.traces(True), candidates, scene.animation, papers)
    whole = scene.traces(True).joined(candidates)
    return free, solve(whole, held.positions, Ipopt(), Objective.HALF_SQUARED)


def avoidance(scene: Crowd, number: int, out: Path) -> list[Row]:
    """Figs 1–3: the original and two thresholds, by the paper's own method and with the first and last frame held."""
    sheet, axes = draw.sheet(3, 2)
    movers = [place for place, name in enumerate(scene.names) if name not in scene.obstacles]
    stones = [scene.animation[0, place] for place, name in enumerate(scene.names) if name in scene.obstacles]
    draw.tracks(axes[0, 0], scene.animation, movers)
    draw.rocks(axes[0, 0], stones, 0.0)
    draw.bare(axes[0, 0], "(a) original", (-0.06, 1.06, -0.06, 1.06))
    axes[1, 0].set_axis_off()
    rows = []
    for column, letter, threshold in zip(axes[:, 1:].T, "bc", (0.1, 0.2), strict=True):
        free, hard = anchored(scene, threshold)
        for axis, x, ends in zip(column, (free.positions, hard.positions), ("the paper's", "ends held"), strict=True):
            draw.tracks(axis, x, movers)
            draw.rocks(axis, stones, threshold)
            draw.bare(axis, f"({letter}) Δ = {threshold}, {ends}", (-0.06, 1.06, -0.06, 1.06))
        got = (
            f"free ends: min {closest(scene, threshold, free.positions):.4f}, ends move {drift(scene, free.positions):.3f}; "
            f"held ends: min {closest(scene, threshold, hard.positions):.6f}, ends move {drift(scene, hard.positions):.0e}, "
            f"σ {hard.stress:.3e}, {(hard.seconds + free.seconds) * 1e3:.0f} ms"
        )
        says = "thresholds satisfied; first and last frame preserved; no figures printed"
        rows.append((f"2019 Fig. {number}, Δ = {threshold}", says, got))
    draw.save(sheet, out / f"mucherino-omer-2019-fig{number}.png")
    return rows


def friends(out: Path) -> list[Row]:
    """Fig. 4: with and without an edge between two pedestrians."""
    scene = pedestrians()
    base, candidates = scene.traces(True), scene.thresholds(0.1)
    apart = solve_with_thresholds(base, candidates, scene.animation, papers)
    whole = base.joined(candidates)
    apart = solve(whole, apart.positions, Ipopt(), Objective.HALF_SQUARED)
    joined = solve_with_thresholds(base.joined(together(scene)), candidates, scene.animation, papers)
    joined = solve(whole.joined(together(scene)), joined.positions, Ipopt(), Objective.HALF_SQUARED)
    sheet, axes = draw.sheet(3)
    shown = (
        (scene.animation, "(a) original"),
        (apart.positions, "(b) no skeleton"),
        (joined.positions, "(c) one edge"),
    )
    for axis, (x, title) in zip(axes[0], shown, strict=True):
        draw.links_between(axis, x, [(0, 1)], 3)
        draw.tracks(axis, x, [0, 1], 18)
        draw.rocks(axis, [scene.animation[0, 2]], 0.1)
        draw.bare(axis, title, (-0.06, 1.06, 0.1, 0.9))
    draw.save(sheet, out / "mucherino-omer-2019-fig4.png")
    gaps = [np.linalg.norm(x[:, 0] - x[:, 1], axis=1) for x, _ in shown[1:]]
    got = (
        f"without: on both sides, {gaps[0].min():.3f}–{gaps[0].max():.3f} m apart; with: on one side, "
        f"{gaps[1].min():.4f}–{gaps[1].max():.4f} m apart; obstacle ≥ {closest(scene, 0.1, joined.positions):.6f} m"
    )
    return [("2019 Fig. 4", "split without the skeleton, together with it", got)]


def hands(out: Path) -> list[Row]:
    """Fig. 5: raised hands with shorter upper arms."""
    body = figure()
    target = shortened_arms(body)
    source, moved = raised_hands(body), raised_hands(target)
    candidates = source.thresholds(0.06)
    base = source.traces(False)
    first = solve_with_thresholds(base.joined(bone_edges(base, target)), candidates, source.animation, papers)
    traced = moved.traces(False)
    wishes = traced.joined(frame_edges(moved.names, moved.animation, 0.01), bone_edges(traced, target), candidates)
    kept = solve(wishes, moved.animation, Ipopt(), Objective.HALF_SQUARED)
    columns = (
        ("original", source.animation, body),
        ("angle transfer", moved.animation, target),
        ("dynDGP, as printed", first.positions, target),
        ("dynDGP + weak E_t", kept.positions, target),
    )
    _draw_hands(columns, out)
    least = {title: closest(source, 0.06, x) for title, x, _ in columns}
    bones = np.abs(kept.errors[kept.graph.edges.kind == "bone"]).max()
    got = (
        f"hand–head: original {least['original']:.4f}, angle transfer {least['angle transfer']:.4f} (collides), first method "
        f"{least['dynDGP, as printed']:.4f}, with E_t {least['dynDGP + weak E_t']:.6f} (Δ = 0.06, bones to {bones:.0e} m); "
        f"{first.seconds:.1f} s and {kept.seconds:.1f} s"
    )
    return [("2019 Fig. 5", "angle transfer makes hands and head collide; the dynDGP does not; all frames change", got)]


def _draw_hands(columns: tuple[tuple[str, np.ndarray, SkeletalStructure], ...], out: Path) -> None:
    sheet, axes = draw.sheet(len(columns), 5, (1.75, 1.75))
    for column, (title, x, structure) in enumerate(columns):
        for row, frame in enumerate((0, 24, 49, 74, 99)):
            axis = axes[row, column]
            draw.bones(axis, x[frame], structure.parents)
            draw.ring(axis, x[frame, 3], 0.06, draw.GREY)
            for hand in (6, 9):
                draw.dot(
                    axis,
                    x[frame, hand],
                    draw.RED if np.linalg.norm(x[frame, hand] - x[frame, 3]) < 0.0599 else draw.BLUE,
                    5,
                )
            draw.bare(axis, title if row == 0 else "", (-0.7, 0.7, 0.68, 2.02))
    for row, frame in enumerate((1, 25, 50, 75, 100)):
        axes[row, 0].set_ylabel(f"frame {frame}")
    draw.save(sheet, out / "mucherino-omer-2019-fig5.png")


def postures(out: Path) -> list[Row]:
    """The posture table of 2017."""
    body = table_one_body()
    x, rows, drawn = body.initial_pose, [], []
    solve(adapt(x, body, body.scaled(1.1)), x, Ipopt(()))  # the first call also loads libraries
    for name, factors in posture_cases().items():
        target = resized(body, factors)
        graph = adapt(x, body, target)
        soft, exact = solve(graph, x), solve(graph, x, Ipopt(()))
        hard = solve(graph, x, Ipopt())
        bones = soft.relative_errors[graph.edges.kind == "bone"].max()
        got = (
            f"σ {stress(graph, x):.4g} → {exact.stress:.6e} (spectral {soft.iterations[0]} iterations, {soft.seconds * 1e3:.1f} ms; "
            f"IPOPT {exact.iterations[0]}); bones off by {bones:.1%}; hard bones σ {hard.stress:.6e}"
        )
        says = "reproduced with slight deformation, < 1 s" if name == "spine +60 %" else "< 1 s"
        rows.append((f"2017, {name}", says, got))
        drawn.append((name, transfer_directions(x, body.parents, target.lengths), soft.positions[0], hard.positions[0]))
    _draw_postures(x, body.parents, drawn, out)
    return rows


def _draw_postures(
    source: np.ndarray, parents: np.ndarray, drawn: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]], out: Path
) -> None:
    sheet, axes = draw.sheet(7, 2, (1.75, 3.1))
    turn = np.array([[np.cos(0.6), np.sin(0.6), 0.0], [0.0, 0.0, 1.0]])
    views = [("original", None, source, None), *drawn]
    for axis, (name, directed, soft, hard) in zip(axes.ravel(), views, strict=True):
        for x, color, lw in ((directed, "#d9c2a0", 1.0), (hard, draw.GREY, 1.4), (soft, draw.BLUE, 1.8)):
            if x is not None:
                draw.bones(axis, (x - x[0]) @ turn.T, parents, color if name != "original" else draw.INK, lw)
        draw.bare(axis, name, (-0.78, 0.78, -1.58, 1.0))
    for color, lw, word in (
        ("#d9c2a0", 1.0, "angle transfer"),
        (draw.BLUE, 1.8, "2017, soft bones"),
        (draw.GREY, 1.4, "hard bones"),
    ):
        axes[0, 0].plot([], [], color=color, lw=lw, label=word)
    axes[0, 0].legend(frameon=False, loc="lower center", fontsize=7)
    draw.save(sheet, out / "mucherino-2017-postures.png")


def formation(out: Path) -> list[Row]:
    """Future work of 2019: six robots that stay rigid while passing an obstacle."""
    scene = team()
    squad = Team(np.arange(6), np.array([6]), Sensing(0.22, 0.34, 0.08, 0.03), least=0.005)
    base, candidates = scene.traces(True), scene.thresholds(0.15)
    split = solve_with_thresholds(base, candidates, scene.animation, papers)
    rigid = solve_formation(base.joined(candidates), split.positions, squad)
    sheet, axes = draw.sheet(3, 1, (3.6, 2.8))
    shown = ((split.positions, "thresholds only", draw.RED), (rigid.positions, "rigid in every frame", draw.BLUE))
    for axis, (x, title, color) in zip(axes[0, :2], shown, strict=True):
        for frame in (0, 13, 20, 26, 39):
            for (a, b), weight in zip(squad.pairs, links(squad, x)[frame], strict=True):
                axis.plot(*x[frame, [a, b]].T, color=draw.INK, alpha=0.75 * weight, lw=0.8, zorder=1)
            axis.scatter(*x[frame, :6].T, s=14, color=draw.shades(5)[(0, 13, 20, 26, 39).index(frame)], zorder=2)
        draw.rocks(axis, [scene.animation[0, 6]], 0.15)
        draw.bare(axis, title, (-0.08, 1.56, 0.0, 1.0))
        axes[0, 2].plot(formation_rigidity(squad, x), label=title, color=color)
    axes[0, 2].axhline(squad.least, color=draw.GREY, ls=":")
    axes[0, 2].set(xlabel="frame", title="rigidity eigenvalue λ₄ [m²]", ylim=(-0.003, 0.078))
    axes[0, 2].legend(frameon=False, loc="upper center")
    draw.save(sheet, out / "formation.png")
    got = (
        f"least λ₄: {formation_rigidity(squad, split.positions).min():.1e} with thresholds only, "
        f"{formation_rigidity(squad, rigid.positions).min():.4f} with the constraint (wanted 0.005); obstacle ≥ "
        f"{distances(candidates, rigid.positions).min():.4f} m (Δ = 0.15); {rigid.seconds:.1f} s"
    )
    return [("Rigid formation past an obstacle", "future work", got)]


def mesh(out: Path) -> list[Row]:
    """§4.4 of 2019: a stiff mesh whose 6th distances are measured anew in every frame."""
    lengths, began = {"pulled by all distances": [], "branch and prune": []}, time.process_time()
    previous, true = np.zeros((6, 3)), stiff_mesh(0, 0.0)[1].edges.lower
    for frame in range(40):
        interval, pulled = stiff_mesh(frame)
        stiff = interval.select(interval.edges.exact)
        found = branch_and_prune(interval, Branching(tolerance=2e-3, samples=41))
        previous = nearest_realization(found, previous) if frame else found.positions[0]
        previous = solve(stiff, previous, Ipopt(())).positions[0]
        lengths["branch and prune"].append(distances(stiff, previous))
        lengths["pulled by all distances"].append(distances(stiff, solve(pulled, previous).positions))
    spent = time.process_time() - began
    sheet, axes = draw.sheet(2, 1, (4.0, 2.4))
    spread = {}
    for axis, (title, table) in zip(axes[0], lengths.items(), strict=True):
        error = 1e3 * (np.array(table) - true[stiff_mesh(0)[0].edges.exact])
        axis.plot(np.arange(1, 41), error, color=draw.RED if title.startswith("pulled") else draw.BLUE, lw=0.8)
        axis.set(xlabel="frame", title=f"{title}: edge errors [mm]", ylim=(-2, 2))
        spread[title] = np.abs(error).max()
    draw.save(sheet, out / "mesh.png")
    got = (
        f"12 mesh edges over 40 frames: off by up to {spread['pulled by all distances']:.2f} mm when all distances pull, "
        f"{spread['branch and prune']:.0e} mm by branch and prune; {spent / 40 * 1e3:.0f} ms a frame"
    )
    return [("2019 §4.4, triangular mesh", "exact distances stay fixed, no vibration", got)]


def networks(_: Path) -> list[Row]:
    """Instances in the style of the public sensor networks."""
    errors, rounds, began = [], [], time.process_time()
    for count in (56, 73, 89, 103, 148):
        for instance in range(2):
            graph, error, attempt = sensor_network(count, instance), np.inf, 0
            while error >= 1e-3 and attempt < 6:
                rough = multistart(graph, list(lifted_starts(graph, 20, attempt)))
                error, attempt = solve(graph, rough.positions, Ipopt(())).largest_error, attempt + 1
            errors.append(error)
            rounds.append(attempt)
    got = (
        f"{sum(error < 1e-3 for error in errors)} of {len(errors)} generated instances of 56–148 sensors to a largest relative "
        f"error < 1e-3 (worst {max(errors):.0e}), in {np.mean(rounds):.1f} rounds of 20 lifted starts, "
        f"{(time.process_time() - began) / len(errors):.1f} s each"
    )
    return [("Sensor networks", "an application of the static problem", got)]


FIGURES: dict[str, Callable[[Path], list[Row]]] = {
    "2019-fig1": lambda out: avoidance(meeting(), 1, out),
    "2019-fig2": lambda out: avoidance(crossing(), 2, out),
    "2019-fig3": lambda out: avoidance(clock(), 3, out),
    "2019-fig4": friends,
    "2019-fig5": hands,
    "interaction-fig2": anticipation,
    "interaction-fig3": two_constraints,
    "2017-postures": postures,
    "online": online,
    "clap": clap,
    "formation": formation,
    "mesh": mesh,
    "networks": networks,
}


def main() -> None:
    """Draw the figures and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(FIGURES), default=list(FIGURES), help="figures to draw")
    parser.add_argument("--out", type=Path, help="folder for pictures and table.md; the default is docs/papers")
    options = parser.parse_args()
    out = options.out or DOCS / "papers"
    out.mkdir(parents=True, exist_ok=True)
    lines = ["| experiment | the paper says | here |", "| --- | --- | --- |"]
    for name in options.only:
        began = time.perf_counter()
        lines += [f"| {what} | {says} | {got} |" for what, says, got in FIGURES[name](out)]
        print(f"{name}: {time.perf_counter() - began:.1f} s", flush=True)
    table = "\n".join(lines) + "\n"
    if options.out is None and options.only == list(FIGURES):
        page = DOCS.parent / "benchmarks/papers.md"
        head, rest = page.read_text(encoding="utf-8").split(START)
        page.write_text(f"{head}{START}\n{table}{END}{rest.split(END)[1]}", encoding="utf-8")
    else:
        (out / "table.md").write_text(table, encoding="utf-8")


if __name__ == "__main__":
    main()
