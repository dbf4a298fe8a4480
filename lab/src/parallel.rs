//! Sharing work between threads whose results do not depend on it.

use std::{
    num::NonZeroUsize,
    sync::{
        atomic::{AtomicBool, AtomicUsize, Ordering},
        mpsc,
    },
};

/// As many threads as there are processors, or as were asked for.
pub(crate) fn threads(asked: Option<usize>) -> usize {
    let processors = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    asked.unwrap_or(processors).max(1)
}

/// Does `work` for each of `items` on some threads, and tells `done` about each as it is done, in any order.
///
/// After a failure nothing new is begun; of all failures the one of the first item is returned.
pub(crate) fn share<T: Sync, R: Send, E: Send>(
    items: &[T],
    threads: usize,
    work: impl Fn(&T) -> Result<R, E> + Sync,
    mut done: impl FnMut(usize, R),
) -> Result<(), E> {
    let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel();
    let mut failed: Option<(usize, E)> = None;
    std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len()) {
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
        drop(sender);
        for (index, result) in receiver {
            match result {
                Ok(result) => done(index, result),
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
    fn all_items_are_done_once_on_any_number_of_threads() {
        let items: Vec<usize> = (0..100).collect();
        for threads in [1, 2, 8, 200] {
            let mut doubled = vec![0; items.len()];
            let worked = share(
                &items,
                threads,
                |&item| Ok::<_, ()>(2 * item),
                |index, result| doubled[index] += result,
            );
            assert_eq!(worked, Ok(()));
            assert!(doubled.iter().zip(&items).all(|(double, item)| *double == 2 * item));
        }
    }

    #[test]
    fn a_failure_stops_the_rest_and_is_told() {
        let items: Vec<usize> = (0..1000).collect();
        let mut done = 0;
        let fail = |&item: &usize| if item == 3 { Err(item) } else { Ok(()) };
        assert_eq!(share(&items, 1, fail, |_, ()| done += 1), Err(3));
        assert_eq!(done, 3);
    }
}
