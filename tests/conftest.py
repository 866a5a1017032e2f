"""Settings for all tests."""

from hypothesis import settings

# Another worker may hold the processor while an example runs, so time is no sign of a fault; the same examples every time.
settings.register_profile("labkit", deadline=None, derandomize=True)
settings.load_profile("labkit")
