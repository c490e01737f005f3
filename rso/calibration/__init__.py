"""`rso run`: plan, runs, surrogates, search, verification, identification, prediction of held-out tests, results."""
