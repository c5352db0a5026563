"""The parts of `follow.py`: drawn worlds, the closed loop and what it reports."""
