"""What is read off a human motion: the floor, the contact schedule, how segments are turned, what the feet do."""
