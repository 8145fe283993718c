"""Filters, summaries and packed files."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_batches import cut_clips, job_of, rows_of, run

import robot_retarget as rr
from robot_retarget.base.errors import UsageError
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.scores.score import FIGURES
from robot_retarget.tools.batch.filters import Chosen, choose, read_filters
from robot_retarget.tools.batch.report import ClipCard, examples_of, pack_all, reasons_of, save_page, write_reports
from robot_retarget.tools.batch.task import Row


def row(clip: str, **figures: float) -> Row:
    return Row("op3", clip, "x", "done", frames=30, fps=30.0, figures=figures)


def test_a_rejected_clip_has_a_reason_for_every_bound_it_misses() -> None:
    one = read_filters()["in_place"]
    rows = [row("still", flight_pct=0, travel_m=0.1, feet_travel_m=0.0), row("walk", flight_pct=3.0, travel_m=2.0)]
    chosen = choose([*rows, replace(rows[0], clip="bad", state="failed", message="broken")], one)
    assert [r.clip for r in chosen.passed] == ["still"]
    reasons = {r.clip: why for r, why in chosen.rejected}
    assert reasons["walk"] == ("flight_pct 3 % is above 2 (a jump)", "travel_m 2 m is above 0.3")
    assert reasons["bad"] == ("failed: broken",)


def test_the_shipped_filters_name_known_figures() -> None:
    filters = read_filters()
    assert {"feasible", "in_place", "no_flight", "upper_body", "trackable", "phuma", "pbhc"} == set(filters)
    assert all(
        bound.figure in FIGURES and bound.least <= bound.most for one in filters.values() for bound in one.bounds
    )


CALM = {"duration_s": 4.0, "moves_deg": 60.0, "root_height_min": 1.0, "flight_pct": 0.0, "jerk_rms": 90.0}
TRACKABLE = {"duration_s": 4.0, "moves_deg": 60.0, "held_pct": 0.0}


@pytest.mark.parametrize(
    ("figures", "cause"),
    [
        ({}, ""),
        ({"duration_s": 0.033}, "too few frames"),
        ({"moves_deg": 0.2}, "T-pose"),
        ({"held_pct": 70.0}, "a seat"),
    ],
)
def test_stills_snippets_and_seats_are_not_trackable_and_the_cause_is_named(
    figures: dict[str, float], cause: str
) -> None:
    reasons = read_filters()["trackable"].reasons(row("clip", **TRACKABLE | figures))
    assert [cause in reason for reason in reasons] == ([True] if cause else [])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[a]\nnothing = 1\n", "names the figure 'nothing'; known: limb_deg_mean"),
        ("[a]\nspeed_p99 = 'fast'\n", r"must be a number or \[least, most\]"),
        ("[a]\ninclude = ['b']\n", r"no filter \[b\]"),
        ("[a]\ninclude = ['a']\n", "includes itself"),
        ("[a", "not TOML"),
    ],
)
def test_a_broken_filter_file_is_refused(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "f.toml").write_text(text)
    with pytest.raises(UsageError, match=expected):
        read_filters(tmp_path / "f.toml")


def test_reports_and_packed_files_hold_every_clip(tmp_path: Path) -> None:
    job = job_of(cut_clips(tmp_path / "clips"), tmp_path / "out")
    run(job)
    rows = rows_of(job.out)
    write_reports(rows, list(read_filters().values()), job, pictures=1)
    with (job.out / "summary.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [line["clip"] for line in table] == ["clap", "walk", "wave"]
    assert float(table[0]["limb_deg_mean"]) == rows[0].figures["limb_deg_mean"]
    page = (job.out / "summary.html").read_text()
    assert (
        "wave" in page
        and "<svg" in page
        and "pictures/op3-" in page
        and "://" not in page.replace("http://www.w3.org", "")
    )
    passed = (job.out / "lists/feasible.txt").read_text().split()
    rejected = (job.out / "lists/feasible_rejected.csv").read_text().splitlines()[1:]
    assert len(passed) + len(rejected) == 3
    pack_all(rows, job, "locomujoco")
    with np.load(job.out / "packed/op3-locomujoco.npz") as packed:
        ends = packed["split_points"]
        assert ends.tolist() == np.cumsum([0, *(row.frames for row in rows)]).tolist()
        walk = rr.load_trajectory(job.out / "op3/walk.npz").qpos
        np.testing.assert_allclose(packed["qpos"][ends[1] : ends[2]], walk, atol=1e-9)
    pack_all(rows, job, "phc")
    assert list(load_pickle(job.out / "packed/op3-phc.pkl")) == ["clap", "walk", "wave"]


def judged_rows() -> tuple[list[Row], list[Chosen]]:
    """Rows of which one passes, one fails, and others are left out with reasons."""
    rows = [
        row("calm", **CALM),
        row("walks", **{**CALM, "flight_pct": 30.0, "travel_m": 2.0}),
        row("sinks", **{**CALM, "ground_pen_max_cm": 7.5, "flight_pct": 12.0}),
        replace(row("broken"), state="failed", message="no human: 2 joints"),
    ]
    return rows, [choose(rows, filter) for filter in read_filters().values()]


def test_the_page_gives_each_clip_its_reasons_and_each_filter_theirs(tmp_path: Path) -> None:
    rows, chosen = judged_rows()
    by_clip = reasons_of(chosen)
    for one in chosen:
        for left, reasons in one.rejected:
            told = by_clip[left.key] if left.state == "done" else [f"{left.state}: {left.message}"]
            assert all(any(said.startswith(reason) for said in told) for reason in reasons)
    examples = examples_of(rows, chosen, 2)
    assert {left.clip for left, _ in examples} == {"walks", "sinks", "calm"}
    text = save_page(rows, chosen, [ClipCard(*one, None, None) for one in examples], tmp_path / "s.html").read_text()
    assert "flight_pct above 2" in text and "flight_pct 30 % is above 2" in text and "no human: 2 joints" in text
    assert "physics_score" not in text and " best " not in text
