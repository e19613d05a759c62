"""Run the program: read ports, feed pipelines, write outputs, and end in order."""
