"""The studio: a local web app on the service, with a library of takes that can be made again.

page  →  guard (token, Host, Origin)  →  routes  →  making (recipe → motions)  →  library
"""
