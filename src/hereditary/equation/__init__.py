"""What is solved: terms, equations, and the systems that marches take."""
