"""What a person takes home: the HTML page of a report, and imu.yaml."""
