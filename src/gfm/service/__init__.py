"""What every service process shares: settings, signals, the loop, and its status."""
