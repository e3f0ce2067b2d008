//! What a process reports of itself to monitoring: whether it is ready, and counts, by HTTP on an
//! address of its own host.
//!
//! `/healthz` answers 200 when the process does its work and 503 before; `/metrics` is Prometheus' text format.

use std::convert::Infallible;
use std::fmt::Write;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use std::{future, io, thread};

use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};

use super::event_queue::event_queue;

/// Connections that are served at a time; more wait in the system's queue.
const CONNECTIONS_MAX: usize = 16;
/// For a request and its answer. Each connection has one.
const REQUEST_DEADLINE: Duration = if cfg!(test) { Duration::from_millis(300) } else { Duration::from_secs(5) };
/// Until the next try, when a connection cannot be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Why health cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum HealthError {
    #[error("--health {0} is not an address of this host alone, expected one such as 127.0.0.1:9464")]
    NotLoopback(SocketAddr),
    #[error("--health {address}: {error}")]
    Bind { address: SocketAddr, error: io::Error },
}

/// What is reported.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Health {
    pub ready: bool,
    pub metrics: Vec<Metric>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// Never falls.
    Counter,
    Gauge,
}

/// A number by Prometheus' conventions: counters end in `_total`, times are in seconds.
#[derive(Clone, PartialEq, Debug)]
pub struct Metric {
    /// Without the prefix `marti_`.
    pub name: &'static str,
    pub help: &'static str,
    pub kind: Kind,
    /// Label names and values; metrics of one name are adjacent.
    pub labels: Vec<(&'static str, String)>,
    pub value: f64,
}

impl Metric {
    pub fn gauge(name: &'static str, help: &'static str, value: f64) -> Self {
        Self { name, help, kind: Kind::Gauge, labels: Vec::new(), value }
    }

    pub fn counter(name: &'static str, help: &'static str, value: u64) -> Self {
        Self { name, help, kind: Kind::Counter, labels: Vec::new(), value: value as f64 }
    }

    #[must_use]
    pub fn of(mut self, label: &'static str, value: impl ToString) -> Self {
        self.labels.push((label, value.to_string()));
        self
    }
}

/// Answers until the runtime ends, with what was sent last.
///
/// # Errors
/// The address is not of this host alone, or cannot be bound.
pub async fn serve(address: SocketAddr) -> Result<watch::Sender<Health>, HealthError> {
    if !address.ip().is_loopback() {
        return Err(HealthError::NotLoopback(address));
    }
    let listener = TcpListener::bind(address).await.map_err(|error| HealthError::Bind { address, error })?;
    let (sender, receiver) = watch::channel(Health::default());
    // Ends with the runtime.
    tokio::spawn(accept(listener, receiver));
    Ok(sender)
}

/// Answers until the process ends, from a thread of its own: a process that joins has no runtime before it has a place.
///
/// # Errors
/// Those of [`serve`]; the system gives no thread.
pub(super) fn serve_aside(address: SocketAddr) -> Result<watch::Sender<Health>, HealthError> {
    let failed = |error| HealthError::Bind { address, error };
    let runtime = event_queue().map_err(failed)?;
    let sender = runtime.block_on(serve(address))?;
    let answer = move || runtime.block_on(future::pending::<()>());
    thread::Builder::new().name("health".to_owned()).spawn(answer).map_err(failed)?;
    Ok(sender)
}

/// Accepts for ever; clients that send nothing, or read nothing, take a place for [`REQUEST_DEADLINE`] at most.
async fn accept(listener: TcpListener, health: watch::Receiver<Health>) {
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, _)) => {
                let health = health.clone();
                tokio::spawn(async move {
                    let _ = timeout(REQUEST_DEADLINE, answer_one(stream, health)).await;
                    drop(place);
                });
            }
            // No descriptors are left, or the client is gone already.
            Err(_) => sleep(ACCEPT_PAUSE).await,
        }
    }
}

async fn answer_one(stream: TcpStream, health: watch::Receiver<Health>) -> Result<(), hyper::Error> {
    let service = service_fn(|request| future::ready(Ok::<_, Infallible>(answer(&request, &health.borrow()))));
    http1::Builder::new().keep_alive(false).serve_connection(TokioIo::new(stream), service).await
}

fn answer(request: &Request<Incoming>, health: &Health) -> Response<Full<Bytes>> {
    let with = |status, body: String| {
        let mut response = Response::new(Full::from(body));
        *response.status_mut() = status;
        response
    };
    match (request.method(), request.uri().path()) {
        (&Method::GET | &Method::HEAD, "/healthz") if health.ready => with(StatusCode::OK, "ready\n".to_owned()),
        (&Method::GET | &Method::HEAD, "/healthz") => with(StatusCode::SERVICE_UNAVAILABLE, "starting\n".to_owned()),
        (&Method::GET | &Method::HEAD, "/metrics") => {
            let mut response = with(StatusCode::OK, text(&health.metrics));
            let text = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
            response.headers_mut().insert(CONTENT_TYPE, text);
            response
        }
        (_, "/healthz" | "/metrics") => with(StatusCode::METHOD_NOT_ALLOWED, "expected GET\n".to_owned()),
        _ => with(StatusCode::NOT_FOUND, "expected /healthz or /metrics\n".to_owned()),
    }
}

/// Each name is described once, before its first value.
fn text(metrics: &[Metric]) -> String {
    let mut out = String::new();
    let mut described = None;
    for Metric { name, help, kind, labels, value } in metrics {
        if described != Some(name) {
            let kind = match kind {
                Kind::Counter => "counter",
                Kind::Gauge => "gauge",
            };
            let _ = writeln!(out, "# HELP marti_{name} {help}\n# TYPE marti_{name} {kind}");
            described = Some(name);
        }
        let labels: Vec<_> = labels.iter().map(|(label, value)| format!("{label}=\"{}\"", escaped(value))).collect();
        let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        let _ = writeln!(out, "marti_{name}{labels} {value}");
    }
    out
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;

    use super::*;

    async fn ask(address: SocketAddr, path: &str) -> String {
        let mut stream = TcpStream::connect(address).await.expect("it listens");
        let request = format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).await.expect("it reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).await.expect("it answers");
        answer
    }

    #[tokio::test]
    async fn it_says_when_it_is_ready_and_counts() {
        // A port that was free a moment ago.
        let address = TcpListener::bind("127.0.0.1:0").await.expect("loopback").local_addr().expect("bound");
        let health = serve(address).await.expect("free");
        assert!(ask(address, "/healthz").await.starts_with("HTTP/1.1 503"));
        let metrics = vec![
            Metric::counter("tiles_done_total", "Tiles done.", 3).of("cluster", 0),
            Metric::counter("tiles_done_total", "Tiles done.", 4).of("cluster", "a\"b"),
            Metric::gauge("seconds", "Since the start.", 0.5),
        ];
        health.send_replace(Health { ready: true, metrics });
        assert!(ask(address, "/healthz").await.starts_with("HTTP/1.1 200"));
        let expected = "# HELP marti_tiles_done_total Tiles done.\n# TYPE marti_tiles_done_total counter\n\
            marti_tiles_done_total{cluster=\"0\"} 3\nmarti_tiles_done_total{cluster=\"a\\\"b\"} 4\n\
            # HELP marti_seconds Since the start.\n# TYPE marti_seconds gauge\nmarti_seconds 0.5\n";
        let answer = ask(address, "/metrics").await;
        assert!(answer.ends_with(expected), "{answer}");
        assert!(answer.contains("text/plain; version=0.0.4"), "{answer}");
        assert!(ask(address, "/else").await.starts_with("HTTP/1.1 404"));
    }

    /// Clients that connect and send nothing, more than are served at a time, are ended; then others are answered.
    #[tokio::test]
    async fn clients_that_send_nothing_are_ended() {
        let address = TcpListener::bind("127.0.0.1:0").await.expect("loopback").local_addr().expect("bound");
        let _health = serve(address).await.expect("free");
        let mut silent = Vec::new();
        for _ in 0..2 * CONNECTIONS_MAX {
            silent.push(TcpStream::connect(address).await.expect("it listens"));
        }
        assert!(ask(address, "/healthz").await.starts_with("HTTP/1.1 503"));
        let mut nothing = [0; 1];
        assert_eq!(silent[0].read(&mut nothing).await.expect("an end"), 0);
    }

    #[tokio::test]
    async fn only_this_host_may_ask() {
        let refused = serve(([0, 0, 0, 0], 0).into()).await.map(drop).expect_err("any interface").to_string();
        assert!(refused.contains("not an address of this host alone"), "{refused}");
    }
}
