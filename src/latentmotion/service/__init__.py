"""The service: motions over HTTP and WebSocket, for programs in any language.

    request → guard (host, token, size) → route → queue → batch → model → file worker → answer

Needs `pip install "latentmotion[serve]"`.
"""
