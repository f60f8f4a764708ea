BEGIN TRANSACTION;
CREATE TABLE monitors (
    session INTEGER NOT NULL,
    name TEXT NOT NULL,
    instance TEXT NOT NULL,
    streams TEXT NOT NULL,       -- JSON: [name, kind] of those that it claimed
    attached INTEGER NOT NULL,
    PRIMARY KEY (session, name)
) WITHOUT ROWID;
INSERT INTO "monitors" VALUES(1,'m1','m1-1','[["/a","topic"]]',1);
INSERT INTO "monitors" VALUES(2,'m1','m1-1','[["/a","topic"]]',1);
CREATE TABLE refused (
    session INTEGER NOT NULL,
    monitor TEXT NOT NULL,
    seq INTEGER NOT NULL,
    gap INTEGER NOT NULL,
    at INTEGER NOT NULL,         -- ns
    code TEXT NOT NULL,
    message TEXT NOT NULL,
    PRIMARY KEY (session, monitor, seq)
) WITHOUT ROWID;
CREATE TABLE sessions (
    number INTEGER PRIMARY KEY,
    id TEXT NOT NULL UNIQUE,
    spec TEXT NOT NULL,          -- the spec's id
    text TEXT NOT NULL,          -- its YAML, as opened
    digest TEXT NOT NULL,
    properties TEXT NOT NULL,    -- JSON: their ids, in the order of `outcomes`
    private INTEGER NOT NULL,    -- closed with its last monitor
    opened INTEGER NOT NULL,     -- ns
    closed INTEGER,              -- ns
    state TEXT                   -- JSON: how it stood when it was closed
);
INSERT INTO "sessions" VALUES(1,'old','single','# One stream and one property: an event is judged as it comes.
id: single
description: A number that is small
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - id: a_is_small
    formula: ''not {topic: "/a", v > 10}''
','a2a8dd9b308ef93c4a90eb791cbc69a8bbd616644fc33994525889eb71b9ef6b','["a_is_small"]',0,1795271336769503152,NULL,NULL);
INSERT INTO "sessions" VALUES(2,'older','single','# One stream and one property: an event is judged as it comes.
id: single
description: A number that is small
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - id: a_is_small
    formula: ''not {topic: "/a", v > 10}''
','a2a8dd9b308ef93c4a90eb791cbc69a8bbd616644fc33994525889eb71b9ef6b','["a_is_small"]',0,1795271336789788124,1795271336809080240,'{"id":"older","spec":"single","spec_digest":"a2a8dd9b308ef93c4a90eb791cbc69a8bbd616644fc33994525889eb71b9ef6b","status":"closed","clock":"wall","opened":1795271336789788124,"closed":1795271336809080240,"monitors":[{"name":"m1","attached":true,"connected":false,"next":2,"credit":311}],"streams":[{"monitor":"m1","stream":"/a","kind":"topic","frontier":1732147200000000000,"depth":0,"lag":63124136809080240,"late":0,"lost":0,"duplicates":0}],"awaited":null,"waiting":null,"hold":{"count":1,"sum":0,"buckets":[{"le":1000000,"count":1},{"le":2000000,"count":1},{"le":5000000,"count":1},{"le":10000000,"count":1},{"le":20000000,"count":1},{"le":50000000,"count":1},{"le":100000000,"count":1},{"le":200000000,"count":1},{"le":500000000,"count":1},{"le":1000000000,"count":1},{"le":2000000000,"count":1},{"le":5000000000,"count":1},{"le":null,"count":1}]},"properties":[{"id":"a_is_small","order":"publication","outcome":"currently_true","first_violation":null,"violations":0,"unknown":0,"broken":null}],"disagree":[],"counters":{"steps":1,"held":0,"refused":0,"late":0,"skewed":0,"skipped":0,"lost":0,"denied":0},"continued_by":null,"clock_went_back":false}');
CREATE TABLE steps (
    session INTEGER NOT NULL,
    position INTEGER NOT NULL,   -- 1, 2, 3…: the sequence in which the session judged
    ord TEXT NOT NULL,
    number INTEGER,              -- the step; NULL where it was skipped
    stream TEXT NOT NULL,
    kind TEXT NOT NULL,
    monitor TEXT NOT NULL,
    seq INTEGER NOT NULL,
    gap INTEGER NOT NULL,        -- sequence numbers before it that never came
    stamp INTEGER NOT NULL,      -- ns
    arrived INTEGER NOT NULL,    -- ns
    judged INTEGER NOT NULL,     -- ns
    late INTEGER NOT NULL,
    skewed INTEGER NOT NULL,
    forced INTEGER NOT NULL,
    lost INTEGER NOT NULL,
    source TEXT NOT NULL,
    call INTEGER,
    ask INTEGER NOT NULL,
    decision TEXT,
    denied_by TEXT NOT NULL,     -- JSON: the denying properties
    passed INTEGER,
    why TEXT,
    signals TEXT NOT NULL,       -- JSON
    failed TEXT NOT NULL,        -- JSON
    outcomes TEXT NOT NULL,      -- a character a property: T t f F u
    degraded TEXT NOT NULL,      -- a character a property: 0 1
    explanations TEXT,           -- JSON, by the property's place; NULL where none became negative
    PRIMARY KEY (session, position)
) WITHOUT ROWID;
INSERT INTO "steps" VALUES(1,1,'publication',1,'/a','topic','m1',1,0,1732147200001000000,1795271336777080956,1795271336777080956,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":1}','[]','t','0',NULL);
INSERT INTO "steps" VALUES(1,2,'publication',2,'/a','topic','m1',2,0,1732147200002000000,1795271336777330008,1795271336777330008,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":2}','[]','t','0',NULL);
INSERT INTO "steps" VALUES(1,3,'publication',3,'/a','topic','m1',3,0,1732147200003000000,1795271336777513986,1795271336777513986,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":77}','[]','f','0','{"0":{"text":"a_is_small does not hold at step 3, /a (topic 3 of m1): not {topic: \"/a\", v > 10}","formula":"not {topic: \"/a\", v > 10}","event":{"stream":"/a","kind":"topic","monitor":"m1","seq":3,"stamp":1732147200003000000,"signals":{"v":77,"topic":"/a","kind":"topic","monitor":"m1"}}}}');
INSERT INTO "steps" VALUES(1,4,'publication',4,'/a','topic','m1',4,0,1732147200004000000,1795271336777580583,1795271336777580583,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":4}','[]','t','0',NULL);
INSERT INTO "steps" VALUES(1,5,'publication',5,'/a','topic','m1',5,0,1732147200005000000,1795271336777648326,1795271336777648326,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":5}','[]','t','0',NULL);
INSERT INTO "steps" VALUES(2,1,'publication',1,'/a','topic','m1',1,0,1732147200000000000,1795271336796864104,1795271336796864104,0,0,0,0,'',NULL,0,NULL,'[]',NULL,NULL,'{"v":1}','[]','t','0',NULL);
CREATE UNIQUE INDEX steps_by_seq ON steps (session, monitor, seq, ord);
CREATE INDEX violations ON steps (session, position) WHERE explanations IS NOT NULL;
COMMIT;
PRAGMA user_version = 1;
