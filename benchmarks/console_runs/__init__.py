"""Camera, links and browsers of the console's benchmarks."""
