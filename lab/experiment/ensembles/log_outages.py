def log_outages(*a): raise NotImplementedError
