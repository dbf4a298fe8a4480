use super::*;
use realfft::RealFftPlanner;

/// Energies of 10 ms frames.
fn frames(clip: &Clip) -> Vec<f32> {
    let mean_square =
        |frame: &[f32]| frame.iter().map(|sample| sample * sample).sum::<f32>() / frame.len() as f32;
    clip.samples.chunks(SAMPLE_RATE_HZ as usize / 100).map(mean_square).collect()
}

fn share_of_energy(clip: &Clip, from_hz: f32, to_hz: f32) -> f32 {
    let forward = RealFftPlanner::<f32>::new().plan_fft_forward(clip.samples.len());
    let mut spectrum = forward.make_output_vec();
    forward.process(&mut clip.samples.to_vec(), &mut spectrum).expect("lengths agree");
    let bin_hz = SAMPLE_RATE_HZ as f32 / clip.samples.len() as f32;
    let part = &spectrum[(from_hz / bin_hz) as usize..(to_hz / bin_hz) as usize];
    let energy =
        |bins: &[realfft::num_complex::Complex32]| bins.iter().map(|bin| bin.norm_sqr()).sum::<f32>();
    energy(part) / energy(&spectrum)
}

#[test]
fn there_are_many_clips_with_different_names_and_sounds() {
    let bank = clip_bank();
    assert!(bank.len() >= 20 && families::FAMILIES.len() >= 5);
    for (index, clip) in bank.iter().enumerate() {
        assert!(bank[..index].iter().all(|other| other.name != clip.name && other.samples != clip.samples));
    }
    let again = make(&families::FAMILIES[3], 2, &finish::Finish::new(CLIP_SAMPLES));
    assert_eq!(again, bank[3 * CLIPS_PER_FAMILY + 2]);
}

#[test]
fn all_clips_are_equally_loud_and_without_sharp_peaks() {
    for clip in clip_bank() {
        let mean_square = frames(&clip).iter().sum::<f32>() / frames(&clip).len() as f32;
        let level_db = 10.0 * (mean_square / (0.05 * 0.05)).log10();
        assert!(level_db.abs() < 0.5, "{}: {level_db} dB off", clip.name);
        let peak = clip.samples.iter().fold(0.0_f32, |peak, sample| peak.max(sample.abs()));
        let crest_db = 10.0 * (peak * peak / mean_square).log10();
        assert!((3.0..=14.0).contains(&crest_db), "{}: crest {crest_db} dB", clip.name);
    }
}

#[test]
fn every_clip_has_lows_and_highs() {
    for clip in clip_bank() {
        let (low, high) = (share_of_energy(&clip, 0.0, 1200.0), share_of_energy(&clip, 2000.0, 8000.0));
        assert!(low >= 0.2 && high >= 0.2, "{}: {low} low, {high} high", clip.name);
    }
}

#[test]
fn every_clip_has_onsets_and_no_long_gap() {
    for clip in clip_bank() {
        let frames = frames(&clip);
        let around = |index: usize| frames[index % frames.len()];
        let (mut onsets, mut gap, mut longest_gap, mut armed) = (0, 0, 0, true);
        for index in 8..frames.len() + 8 {
            let before = (1..=6).map(|back| around(index - back)).fold(f32::INFINITY, f32::min);
            let rises = around(index) > 4.0 * before && around(index) > 0.25 * 0.05 * 0.05;
            onsets += usize::from(rises && armed);
            armed = !rises;
            gap = if around(index) < 1e-4 * 0.05 * 0.05 { gap + 1 } else { 0 };
            longest_gap = longest_gap.max(gap);
        }
        assert!(onsets >= 18, "{}: {onsets} onsets in 6 s", clip.name);
        assert!(longest_gap <= 15, "{}: silent for {longest_gap}0 ms", clip.name);
    }
}

#[test]
fn the_end_of_a_clip_leads_into_its_start() {
    for clip in clip_bank() {
        let last = clip.samples.len() - 1;
        let mut bends: Vec<f32> = clip.samples.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()).collect();
        bends.sort_by(f32::total_cmp);
        let seam = (clip.samples[last - 1] - 2.0 * clip.samples[last] + clip.samples[0]).abs();
        assert!(seam <= bends[bends.len() * 999 / 1000], "{}: a step of {seam}", clip.name);
    }
}
