"""Scripts that run the experiments; `python -m train.NAME --help` explains each."""
