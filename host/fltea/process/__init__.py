"""What a program that runs for long needs of the machine: signals that end it, wake-ups, the date."""
