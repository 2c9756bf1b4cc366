"""Quadratic programs in rational arithmetic: their data, linear algebra, active sets and optima."""
