"""From landmark curves to a certified map: detection, the fit, checked networks, `register`, and its judges."""
