"""Questions asked of schemes and steppers (floor 5)."""
