"""What others make of the same recordings: tools and methods with every doubt in their favour.

They read the files that `gfm diagnose` reads, through gfm's own reader; rollouts, where a tool
brings none of its own, and held-out errors are gfm's too.
"""
