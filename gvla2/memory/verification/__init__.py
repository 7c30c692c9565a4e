"""What a verifier that reads is asked, and what its answer says."""
