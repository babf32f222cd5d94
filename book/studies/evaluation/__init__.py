"""The parts of `networks.json`, one module each."""
