"""What several tests need: small inputs, other processes, and answers to compare with."""
