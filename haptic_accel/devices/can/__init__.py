"""Arms whose joints are driven by ODrives on a CAN bus, through any interface of python-can."""
