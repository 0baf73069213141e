"""Adaptive collocation: scheme, equations of a step, singular starts, stepper."""
