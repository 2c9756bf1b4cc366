"""Reports: figures are computed in `figures` and rendered elsewhere."""
