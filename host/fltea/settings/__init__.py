"""All settings of the program: how they are declared, read and checked."""
