"""The tracker: particle filter and cues put together, with presets and track states."""
