"""Large systems: linearly implicit schemes, and memory terms for other codes."""
