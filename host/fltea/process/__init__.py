"""What a program that runs for long needs of the system: signals that end it, a wake-up, its date."""
