"""Sessions beside a policy: times, hostile commands, arms above the legs of others."""
