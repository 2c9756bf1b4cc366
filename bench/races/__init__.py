"""The race: its settings, plan, tasks, measurements and report."""
