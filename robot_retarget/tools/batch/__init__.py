"""Many clips onto many robots: a manifest, workers within limits, filters and summaries."""
