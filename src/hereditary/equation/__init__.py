"""Terms, equations, and the systems that marches solve."""
