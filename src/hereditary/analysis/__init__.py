"""Questions asked of schemes and steppers."""
