//! Parallel work with results independent of the thread count.

use std::num::NonZeroUsize;
use std::sync::{
    atomic::{AtomicBool, AtomicUsize, Ordering},
    mpsc,
};

/// Applies `work` to every item on several threads (`None` for one per processor), and `done` to the results in any order.
///
/// # Errors
/// The failure with the lowest index; later items are not begun.
pub(crate) fn share<T: Sync, R: Send, E: Send>(
    items: &[T],
    threads: Option<usize>,
    work: impl Fn(&T) -> Result<R, E> + Sync,
    mut done: impl FnMut(usize, R),
) -> Result<(), E> {
    let processors = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let threads = threads.unwrap_or(processors).clamp(1, items.len().max(1));
    let next = AtomicUsize::new(0);
    let stop = AtomicBool::new(false);
    let (sender, receiver) = mpsc::channel();
    let mut failed: Option<(usize, E)> = None;
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (next, stop, work, sender) = (&next, &stop, &work, sender.clone());
            scope.spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(index) else { return };
                    let result = work(item);
                    stop.fetch_or(result.is_err(), Ordering::Relaxed);
                    if sender.send((index, result)).is_err() {
                        return;
                    }
                }
            });
        }
        // The receiver ends when all senders are dropped, including this one.
        drop(sender);
        for (index, result) in receiver {
            match result {
                Ok(result) => done(index, result),
                // Several threads may fail at once: the lowest index makes the error reproducible.
                Err(error) if failed.as_ref().is_none_or(|first| index < first.0) => {
                    failed = Some((index, error));
                }
                Err(_) => {}
            }
        }
    });
    failed.map_or(Ok(()), |(_, error)| Err(error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_done_once_on_any_thread_count() {
        let items: Vec<usize> = (0..100).collect();
        for threads in [1, 2, 8, 200] {
            let mut doubled = vec![0; items.len()];
            let worked = share(
                &items,
                Some(threads),
                |&item| Ok::<_, ()>(2 * item),
                |index, result| doubled[index] += result,
            );
            assert_eq!(worked, Ok(()));
            assert!(doubled.iter().zip(&items).all(|(double, item)| *double == 2 * item));
        }
    }

    #[test]
    fn a_failure_is_returned_and_stops_the_rest() {
        let items: Vec<usize> = (0..1000).collect();
        let mut done = 0;
        let fail = |&item: &usize| if item == 3 { Err(item) } else { Ok(()) };
        assert_eq!(share(&items, Some(1), fail, |_, ()| done += 1), Err(3));
        assert_eq!(done, 3);
    }
}
