-- TimescaleDB 2.13 or newer, for a fleet: run it after ../postgresql/schema.sql, on the empty database; ../postgresql/consumer.py
-- then writes as before. NOT RUN IN CI (TimescaleDB is in no registry that CI has): the statements marked "timescale" are
-- written by its documentation, all others are run by a test on PostgreSQL 15.

CREATE EXTENSION IF NOT EXISTS timescaledb; -- timescale

-- The key of a hypertable must have the column that it is divided by, and that is never null: what was never read (value null,
-- quality bad) has the epoch in its place. A message's time never changes, so the key still names it once.
ALTER TABLE message RENAME TO message_stored;
ALTER TABLE message_stored DROP CONSTRAINT message_pkey;
ALTER TABLE message_stored ALTER COLUMN time SET NOT NULL;
ALTER TABLE message_stored ADD PRIMARY KEY (topic, boot, seq, time);

-- The piece that is written to should fit into memory: for 1,000 gateways whose motors all run a quarter of an hour is up to 23 million
-- rows (docs/fleet.md); at a standstill a fifth of that. Choose longer pieces for fewer gateways.
SELECT create_hypertable('message_stored', by_range('time', INTERVAL '15 minutes')); -- timescale
ALTER TABLE message_stored SET (timescaledb.compress, timescaledb.compress_segmentby = 'topic', timescaledb.compress_orderby = 'time, seq'); -- timescale
SELECT add_compression_policy('message_stored', INTERVAL '1 day'); -- timescale
SELECT add_retention_policy('message_stored', INTERVAL '2 years'); -- timescale

-- The consumer writes to `message`: each message once, as before.
CREATE VIEW message AS SELECT topic, boot, seq, nullif(time, 'epoch') AS time, payload, arrived FROM message_stored;
CREATE FUNCTION store_message() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO message_stored (topic, boot, seq, time, payload)
    VALUES (NEW.topic, NEW.boot, NEW.seq, coalesce(NEW.time, 'epoch'), NEW.payload) ON CONFLICT DO NOTHING;
    RETURN NEW;
END $$;
CREATE TRIGGER store INSTEAD OF INSERT ON message FOR EACH ROW EXECUTE FUNCTION store_message();
