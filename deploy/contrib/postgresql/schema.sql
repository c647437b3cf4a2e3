-- What consumer.py writes. PostgreSQL 13 or newer.

-- Every message that (topic, boot, seq) names: values (those that came late in `history` too), states, alarms, events,
-- starts, trips, audit.
CREATE TABLE message (
    topic text NOT NULL,
    boot text NOT NULL, -- the run of the gateway
    seq bigint NOT NULL, -- counts up over everything that this run publishes
    time timestamptz, -- when it was read or happened; null: never
    payload jsonb NOT NULL,
    arrived timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (topic, boot, seq)
);
CREATE INDEX message_time ON message (time);

-- The runs of the gateways. What a run could not send may come after what a later run has sent: so the order of two runs is
-- that of the first things that were read in them, not of their arrival.
CREATE TABLE run (
    boot text PRIMARY KEY,
    began timestamptz NOT NULL
);

-- Each phase of each command.
CREATE TABLE result (
    topic text NOT NULL,
    id text NOT NULL, -- of the command; empty: it had none
    phase text NOT NULL,
    duplicate boolean NOT NULL, -- the stored result, sent again
    time timestamptz NOT NULL,
    payload jsonb NOT NULL,
    arrived timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (topic, id, phase, duplicate, time)
);

-- What was published below these topics and is none of the above: another program writes where only the gateway may.
CREATE TABLE unreadable (
    topic text NOT NULL,
    payload bytea NOT NULL,
    digest bytea GENERATED ALWAYS AS (sha256(payload)) STORED,
    arrived timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (topic, digest)
);

-- The values, typed, in order of each topic by (began, seq). `base` may have any depth, so a topic is read from its end.
CREATE VIEW reading AS
SELECT
    substring(m.topic FROM '^(.*)/starter/[^/]+/value/[^/]+$') AS base,
    substring(m.topic FROM '/starter/([^/]+)/value/[^/]+$') AS starter,
    substring(m.topic FROM '/starter/[^/]+/value/([^/]+)$') AS point,
    m.time,
    CASE jsonb_typeof(m.payload -> 'value') WHEN 'number' THEN (m.payload ->> 'value')::double precision END AS number,
    CASE jsonb_typeof(m.payload -> 'value') WHEN 'boolean' THEN (m.payload ->> 'value')::boolean END AS flag,
    CASE jsonb_typeof(m.payload -> 'value') WHEN 'string' THEN m.payload ->> 'value' END AS text,
    m.payload ->> 'unit' AS unit, -- null: it came late, in `history`
    m.payload ->> 'quality' AS quality,
    r.began,
    m.boot,
    m.seq
FROM message AS m
LEFT JOIN run AS r USING (boot)
WHERE m.topic ~ '/starter/[^/]+/value/[^/]+$';
