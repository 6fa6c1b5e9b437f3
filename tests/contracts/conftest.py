from hypothesis import settings

# The same examples in each run, and no time limit for one: a busy machine is not a failure.
settings.register_profile("deterministic", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("deterministic")
