"""The engine `ray`, on a real Ray of two nodes on this machine."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from shared_files import ROOT
from small_batches import contents, cut_clips, here, job_of, run

from robot_retarget.tools.batch.pool import Report, Stopping, run_ray
from robot_retarget.tools.batch.task import Allowance, Task

ray: Any = pytest.importorskip("ray", reason="needs Ray, the extra cluster")


@pytest.fixture(scope="module")
def nodes() -> Iterator[Any]:
    """A cluster of two nodes with a processor each; yields it."""
    from ray.cluster_utils import Cluster

    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 100 * 2**20}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    cluster.second = cluster.add_node(num_cpus=1, object_store_memory=100 * 2**20)  # type: ignore[attr-defined]
    ray.init(address=cluster.address, log_to_driver=False)
    yield cluster
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut_clips(tmp_path_factory.mktemp("clips"), ("wave", "walk", "clap", "squat"))


@pytest.fixture(scope="module")
def done(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("done") / "out"
    run(job_of(clips, out), here)
    return contents(out)


def test_a_cluster_writes_the_same_bytes_and_a_lost_node_loses_nothing(
    nodes: Any, clips: Path, done: dict[str, bytes], tmp_path: Path
) -> None:
    run(job_of(clips, tmp_path / "whole"), run_ray)
    assert contents(tmp_path / "whole") == done

    def losing(tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping) -> None:
        """The second node dies as soon as the first clip is done."""

        def reported(outcome: Any) -> None:
            report(outcome)
            if nodes.second is not None:
                nodes.remove_node(nodes.second, allow_graceful=False)
                nodes.second = None

        run_ray(tasks, allowance, reported, stopping)

    ended, _ = run(job_of(clips, tmp_path / "lost"), losing)
    assert nodes.second is None and ended.states == {"done": 4}
    assert contents(tmp_path / "lost") == done
