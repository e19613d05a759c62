"""The outputs to which the program writes its records."""
