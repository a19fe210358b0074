"""Finger mechanics and SA1 afferents: what a finger feels when it strokes a surface."""
