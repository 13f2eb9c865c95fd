-- Tables of the library. A take is a row; its edits are settings, and to delete it is a mark.
CREATE TABLE IF NOT EXISTS takes (
    id TEXT PRIMARY KEY, made TEXT NOT NULL, title TEXT NOT NULL, recipe TEXT NOT NULL,
    motion TEXT NOT NULL, frames INTEGER NOT NULL, fps REAL NOT NULL, tags TEXT NOT NULL,
    star INTEGER NOT NULL, deleted INTEGER NOT NULL, edits TEXT NOT NULL, goals TEXT,
    words TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS takes_newest ON takes (deleted);
CREATE INDEX IF NOT EXISTS takes_tagged ON takes (deleted, tags) WHERE tags <> '[]';
CREATE TABLE IF NOT EXISTS characters (
    id TEXT PRIMARY KEY, name TEXT NOT NULL, ending TEXT NOT NULL, bones TEXT NOT NULL,
    deleted INTEGER NOT NULL
);
