"""What others can compute again: material cards and input files of other programs, and what they cannot say."""
