"""The studio: one page on which a clip is carried over to a robot, corrected, judged and exported."""
