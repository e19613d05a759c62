"""The daemon, put through faults by a device that knows what it sent: what is lost, and is it counted?"""
