"""From image messages to arrays."""
