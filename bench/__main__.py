"""``python -m bench`` is the ``piezobench`` command."""

from bench.cli import main

if __name__ == "__main__":
    main()
