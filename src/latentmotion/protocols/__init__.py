"""Protocols of other programs: MMCP for animation tools, MCP for agents."""
