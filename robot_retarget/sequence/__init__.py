"""Clips as a repertoire: sequences, splices and ways into a stand, made of trajectories and solved as any motion."""
