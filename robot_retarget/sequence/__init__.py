"""Clips as a repertoire: sequences, splices and ways into a stand, built from trajectories and solved as any motion."""
