"""The built wheel is whole: models and sample clips are inside, and it works without the checkout."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from shared_files import ROOT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr[-2000:]
    return next(folder.glob("*.whl"))


def test_models_and_samples_are_inside(wheel: Path) -> None:
    inside = zipfile.ZipFile(wheel).namelist()
    assert {"robot_retarget/models/op3/op3.xml", "robot_retarget/models/op3/scene.xml", "robot_retarget/py.typed"} <= {
        *inside
    }
    tables = {"robot_retarget/models/op3/servos.toml", "robot_retarget/actuators/xm430_w350.csv"}
    assert tables | {
        "robot_retarget/base/card.html",
        "robot_retarget/tools/view/page.html",
        "robot_retarget/tools/view/pages.css",
    } <= {*inside}
    shipped = {f"robot_retarget/samples/{path.name}" for path in (ROOT / "samples").glob("*.bvh")}
    assert len(shipped) >= 4 and shipped <= {*inside}


def test_the_licences_of_the_scripts_inside_stand_in_the_metadata(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        metadata = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        stated = [
            line.removeprefix("License-File: ")
            for line in archive.read(metadata).decode().splitlines()
            if line.startswith("License-File")
        ]
        texts = [archive.read(metadata.replace("METADATA", f"licenses/{name}")).decode() for name in stated]
    assert any("Apache License" in text for text in texts)
    assert any(
        "three.js" in text and "uPlot" in text and text.count("Permission is hereby granted") == 2 for text in texts
    )


def test_an_environment_without_the_checkout_retargets_with_it(wheel: Path, tmp_path: Path) -> None:
    """It shares the dependencies of this one; `scripts/tools/check_release.py` installs them anew."""
    venv.create(tmp_path / "venv")
    python = tmp_path / "venv/bin/python"
    command = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", str(wheel)]
    installed = subprocess.run(command, capture_output=True, text=True)
    assert installed.returncode == 0, installed.stderr[-2000:]
    own = next((tmp_path / "venv/lib").glob("python3*/site-packages"))
    (own / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    quiet = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    script = "import robot_retarget.base.files as s; print(s.SAMPLES / 'wave.bvh')"
    clip = subprocess.run(
        [python, "-c", script], capture_output=True, text=True, cwd=tmp_path, env=quiet
    ).stdout.strip()
    assert str(tmp_path) in clip
    command = [
        tmp_path / "venv/bin/robot-retarget",
        "solve",
        clip,
        "--robot",
        "op3",
        "--frames",
        "0:10",
        "-o",
        "out.npz",
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=quiet)
    assert done.returncode == 0 and (tmp_path / "out.npz").is_file(), done.stderr[-2000:]
