"""Terms and equations that a user states, and the systems that steppers solve."""
