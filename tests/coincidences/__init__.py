"""Cases in which things coincide on purpose, each with an exact answer that owes nothing to
labkit.

Every module here but `findings` and `reference` is a *kind*:

generate(random) -> case          from a random.Random; a case prints itself
    METHODS                           the methods that suit the kind
    check(case, backend, method)      -> list of Complaint; empty when labkit is right
    expected(case)                    -> how many events there are, for the table

`tests/test_coincidences.py` tries a few cases of each; `python -m tests.coincidences 10000`
many.
"""

KINDS = (
    "bodies",
    "counters",
    "billiard",
    "floors",
    "contacts",
    "belt",
    "surfaces",
    "jumps",
    "pwm",
    "touches",
    "scales",
    "restarts",
    "linear",
)
