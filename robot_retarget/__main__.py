"""The program: `robot-retarget`, `python -m robot_retarget`."""

import os
import signal
import sys


def main() -> None:
    """Run the command line. Ctrl-C while it loads ends it without a word."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    _open_streams()
    from robot_retarget.tools.cli import main as command_line

    command_line()


def _open_streams() -> None:
    """Where stdout is closed, output goes to a pipe without a reader; where stderr is closed, messages go nowhere."""
    if sys.stdout is None:
        reader, writer = os.pipe()
        os.close(reader)
        os.dup2(writer, 1)
        sys.stdout = os.fdopen(1, "w")
    if sys.stderr is None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        sys.stderr = os.fdopen(2, "w")


if __name__ == "__main__":
    main()
