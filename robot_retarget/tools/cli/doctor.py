"""`doctor`: missing parts of this machine, and their cures."""

from typing import TYPE_CHECKING

import typer

from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import command
from robot_retarget.tools.cli.options import PrintOptions

if TYPE_CHECKING:
    from robot_retarget.tools.doctor import ComponentStatus

commands: typer.Typer = typer.Typer()


@command(commands, epilog="Example: robot-retarget doctor --json")
def doctor(printing: PrintOptions) -> None:
    """Examine Python, MuJoCo, rendering, compiler, ffmpeg, extras and serial ports. Exit code 1 if a needed part is missing."""
    from dataclasses import asdict

    from robot_retarget.tools.doctor import examine

    findings = examine()
    printing.show([asdict(finding) for finding in findings], lambda _: _show(findings))
    raise typer.Exit(1 if any(finding.state == "missing" for finding in findings) else 0)


def _show(findings: "list[ComponentStatus]") -> None:
    console.table("", ("part", "state", "detail"), [(f.part, f.state, f.detail) for f in findings])
    for finding in findings:
        if finding.cure and finding.state != "ok":
            console.say(f"{finding.part}: {finding.cure}")
