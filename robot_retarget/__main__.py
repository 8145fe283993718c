"""`python -m robot_retarget`."""

from robot_retarget.cli import main

main()
