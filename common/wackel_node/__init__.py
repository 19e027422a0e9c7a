"""What every process of wackel shares: configuration, clock, session, life cycle, logging."""
