"""Periodic gaits of the swimmer by direct collocation, and how they are swum on MuJoCo (docs/gaits.md).

``equations`` and ``transcription`` need CasADi (the extra ``gaits``); ``gait``, ``starts`` and ``replay`` do not.
"""
