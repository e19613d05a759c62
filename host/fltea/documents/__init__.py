"""Write what users take away: the charts and HTML page of a report, and files for other programs."""
