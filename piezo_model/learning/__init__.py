"""Learning while the machine runs: the machine of phases, the continuous mode, and their guards."""
