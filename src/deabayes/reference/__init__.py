"""Scripts that simulate the reference specimens shipped in data/.

Each uses another solver than inference does and physics richer than the
candidates, so that no candidate is exact.
"""
