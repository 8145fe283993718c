"""Defects of captures, found, reported, and repaired if the repair is safe: jumps, gaps, noise, sparse keyframes."""

from robot_retarget.human.repair.footing import FootingRule as FootingRule
from robot_retarget.human.repair.footing import footing as footing
from robot_retarget.human.repair.repair import RepairRule as RepairRule
from robot_retarget.human.repair.repair import repaired as repaired
