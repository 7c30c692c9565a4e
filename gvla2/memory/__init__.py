"""The governed KnowledgeBank: experience that can be trusted."""
