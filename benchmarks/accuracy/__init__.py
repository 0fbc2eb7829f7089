"""What every estimator reaches over many seeds on a plant that is not its own: see ``__main__``."""
