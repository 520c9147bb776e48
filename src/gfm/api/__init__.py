"""What a program may ask for: models and recordings in, answers out; the commands stand on it.

`import gfm` offers what is meant for people (`gfm.diagnose`, ...) and loads this when it is used.
"""
