"""Changes of trajectories: cuts, mirror images, sequences, ways into a stand, touch-ups."""
