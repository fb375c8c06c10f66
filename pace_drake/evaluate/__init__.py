"""What a run was like: events, idle times, cost, pictures."""
