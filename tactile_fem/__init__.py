"""Finger mechanics and SA1 afferents: what does a finger feel when it strokes a surface?"""
