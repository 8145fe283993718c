"""Programs for people: batches, views, the command line."""
