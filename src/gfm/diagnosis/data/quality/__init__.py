"""What recordings are worth before anything is concluded from them: findings, for the report.

They come from short checks, one a property, each with its threshold explained beside it.
"""
