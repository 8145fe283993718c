"""`doctor`: missing parts of this machine, and their cures."""

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Json, Quiet

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget doctor --json")
def doctor(json: Json = False, quiet: Quiet = False) -> None:
    """Examine Python, MuJoCo, rendering, compiler, ffmpeg, extras and serial ports. Exit code 1 if a needed part is missing."""
    from dataclasses import asdict

    from robot_retarget.doctor import examine

    findings = examine()
    if json:
        console.dump([asdict(finding) for finding in findings])
    else:
        console.table("", ("part", "state", "detail"), [(f.part, f.state, f.detail) for f in findings])
        for finding in findings:
            if finding.cure and finding.state != "ok":
                console.say(f"{finding.part}: {finding.cure}")
    raise typer.Exit(1 if any(finding.state == "missing" for finding in findings) else 0)
