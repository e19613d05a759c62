"""What a program that runs for long needs of the system: signals that end it, wake-ups, the date."""
