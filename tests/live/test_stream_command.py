"""The command `stream` as a person types it: sources, places for poses, mistakes, Ctrl-C."""

import json
import socket
import subprocess
from pathlib import Path

import forked
import pytest
from perform import send
from performers import HOST, clip

from robot_retarget.base.files import SAMPLES

WAVE = str(SAMPLES / "wave.bvh")


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return forked.run("stream", *words)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--robot"),
        (("--robot", "op3", "--to", "mars"), "is not one of 'stdout', 'view', 'servos'"),
        (("--robot", "op3", "--from", "nowhere.bvh"), "neither a motion file nor one of vmc, json"),
        (("--robot", "op3", "--from", WAVE, "--port", "9"), "--port applies to received frames"),
        (("--robot", "op3", "--from", WAVE, "--to", "servos"), "--serial"),
        (("--robot", "nobody", "--from", WAVE), "nobody"),
        (("--robot", "op3", "--from", WAVE, "--sender", HOST), "--sender applies to received frames"),
        (("--robot", "op3", "--from", "json", "--sender", HOST), "--sender needs --port"),
        (("--robot", "op3", "--port", "0", "--sender", "no.such.name.invalid"), "--sender no.such.name.invalid"),
    ],
)
def test_a_mistake_is_named_and_ends_with_2(words: tuple[str, ...], said: str) -> None:
    done = run(*words)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert not done.stdout


def test_a_port_that_is_taken_is_said() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((HOST, 0))
        done = run("--robot", "op3", "--host", HOST, "--port", str(taken.getsockname()[1]))
    assert done.returncode == 2 and "--port takes another" in done.stderr


@pytest.mark.parametrize("words", [(), ("--to", "servos", "--serial", "emulated")])
def test_without_a_sender_a_stream_ends_after_its_seconds_and_says_so(words: tuple[str, ...], tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOST, 0))
        port = str(free.getsockname()[1])
    done = run(
        "--robot", "op3", "--port", port, "--seconds", "0.3", "--json", "--log", str(tmp_path / "play.npz"), *words
    )
    assert done.returncode == 2
    assert f"no frame of a performer arrived at 127.0.0.1:{port} within 0.3 s" in done.stderr
    said = done.stdout + done.stderr
    figures = json.loads(said[said.index("{") : said.rindex("}") + 1])
    assert figures["frames"] == 0 and figures["latency_p50_ms"] is None and "nan" not in said.lower()


def test_the_sender_sends_in_real_time_and_says_how_much() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind((HOST, 0))
        figures = send(clip(fps=50), f"json://{HOST}:{ear.getsockname()[1]}", seconds=1.0)
        ear.settimeout(1.0)
        assert b"skeleton" in ear.recv(1 << 16)
    assert figures["frames"] == pytest.approx(50, abs=5) and figures["seconds"] == pytest.approx(1.0, abs=0.2)
