"""What poses are for: lines, a page, simulated servos, real ones."""
