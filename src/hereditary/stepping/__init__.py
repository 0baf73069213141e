"""The interface of steppers, and code for runs both with given and with adaptive steps."""
