"""A Sawyer as its controller shows it: Intera's topics, over rosbridge."""
