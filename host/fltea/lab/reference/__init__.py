"""The paper's algorithm in numpy, for any number of states: the reference for faster implementations."""
