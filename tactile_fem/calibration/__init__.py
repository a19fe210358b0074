"""Fits tissues and finger to somebody's measurements: forces over depth, profiles of the skin.

Its modules need DOLFINx, except `measurements` and `parameters`.
"""
