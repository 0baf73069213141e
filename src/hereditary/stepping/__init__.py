"""The contract of steppers, and what runs on given and on chosen steps share."""
